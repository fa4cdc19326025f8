// SPDX-License-Identifier: Apache-2.0
#include "host/files/run_folder.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fstream>
#include <random>
#include <stdexcept>
#include <sys/stat.h>

namespace vitreo {
namespace {

// The wall clock, as names of folders and the record's head have it; within a run all times are
// those of its Clock. localtime_r() because several threads may ask.
std::string local_time(const char* format) {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  localtime_r(&now, &parts);
  char text[64];
  return std::string(text, std::strftime(text, sizeof text, format, &parts));
}

}  // namespace

std::string wall_time_text() { return local_time("%Y-%m-%dT%H:%M:%S%z"); }

std::string utc_text(std::chrono::system_clock::time_point moment) {
  const auto whole = std::chrono::floor<std::chrono::seconds>(moment);
  const std::time_t seconds = std::chrono::system_clock::to_time_t(whole);
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[64];
  const std::size_t size = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &parts);
  const auto rest = std::chrono::duration_cast<std::chrono::microseconds>(moment - whole);
  std::snprintf(text + size, sizeof text - size, ".%06dZ", static_cast<int>(rest.count()));
  return text;
}

// Not from the run's seed: two runs of one seed that begin in the same second need other names.
std::string random_hex(int digits) {
  std::random_device entropy;
  std::string text;
  for (int i = 0; i < digits; ++i) text += "0123456789abcdef"[entropy() % 16];
  return text;
}

// Every run of other characters becomes one underscore, none at either end.
// Compared by hand and not by isalnum(), which depends on the locale: a name must be the same on
// every machine. 48 characters leave room for date, random digits and endings below the 255 bytes
// that a file system allows for a name.
std::string slug(std::string_view text, const std::string& fallback) {
  constexpr std::size_t kLongest = 48;
  std::string result;
  bool gap = false;
  for (char c : text) {
    const bool kept = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                      c == '-' || c == '_';
    if (kept && gap && !result.empty()) result += '_';
    if (kept) result += c;
    gap = !kept;
    if (result.size() >= kLongest) break;
  }
  return result.empty() ? fallback : result;
}

std::filesystem::path make_run_folder(const std::filesystem::path& parent,
                                      const std::string& name) {
  std::error_code error;
  std::filesystem::create_directories(parent, error);
  if (error)
    throw FolderError("the folder for runs cannot be made: " + parent.string() + ": " +
                      error.message());
  // Four random digits: a collision within one second is rare, a hundred of them mean that
  // something else is wrong.
  for (int attempt = 0; attempt < 100; ++attempt) {
    const auto folder =
        parent / (local_time("%Y-%m-%dT%H%M%S") + "_" + slug(name, "run") + "_" + random_hex(4));
    // mkdir is the one call that makes a folder or says that it was there: two runs never share
    // one.
    if (::mkdir(folder.c_str(), 0777) == 0) return folder;
    if (errno != EEXIST)
      throw FolderError("a run's folder cannot be made: " + folder.string() + ": " +
                        std::strerror(errno));
  }
  throw std::runtime_error(parent.string() + ": no free name for a run folder");
}

// The part file stands in the same folder, because rename() replaces a file at once only within one
// file system. Nothing here waits for the disk: it guards against an end of the program, not of the
// power.
void write_file(const std::filesystem::path& file, std::string_view bytes) {
  const std::filesystem::path part = file.string() + ".part";
  // Streams do not promise to set errno: where it stays 0 the reason is not known.
  errno = 0;
  std::ofstream out(part, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  // Before the test: close() writes the last buffer, and may be what fails.
  out.close();
  std::error_code error;
  if (out) {
    std::filesystem::rename(part, file, error);
    if (!error) return;
  }
  const std::string reason = error        ? error.message()
                             : errno != 0 ? std::strerror(errno)
                                          : "cannot be written";
  std::filesystem::remove(part, error);
  throw std::runtime_error(file.string() + ": " + reason);
}

}  // namespace vitreo
