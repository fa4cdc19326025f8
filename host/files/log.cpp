// SPDX-License-Identifier: Apache-2.0
#include "host/files/log.h"

#include "host/files/posix_file.h"
#include "host/files/run_folder.h"
#include "host/files/state_folder.h"

#include <cstdlib>
#include <fcntl.h>
#include <iostream>
#include <mutex>
#include <stdexcept>
#include <sys/file.h>
#include <unistd.h>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

// One for the program and not one a session: the log takes lines before a session exists and after
// it has gone. `mutex` orders the threads of this program, Lock the programs.
struct Log {
  std::mutex mutex;
  fs::path file;  // empty: none
  LogLimits limits;
  bool complained = false;
};

Log& the_log() {
  static Log log;
  return log;
}

fs::path numbered(const fs::path& file, int number) {
  return file.string() + "." + std::to_string(number);
}

/// host.log becomes host.log.1, that host.log.2, and so on; the oldest is removed.
void rotate(const Log& log) {
  std::error_code ignored;  // what is not there yet cannot be moved
  fs::remove(numbered(log.file, log.limits.kept), ignored);
  for (int number = log.limits.kept; number > 1; --number)
    fs::rename(numbered(log.file, number - 1), numbered(log.file, number), ignored);
  fs::rename(log.file, numbered(log.file, 1), ignored);
}

/// Advisory lock of the log's own lock file: other programs wait while it lives, and the system
/// releases it when this one dies. Not of the log itself, which is renamed under it.
class Lock {
 public:
  explicit Lock(const fs::path& file)
      : descriptor_(::open(file.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0644)) {
    if (descriptor_ < 0) throw std::runtime_error(file.string() + ": cannot be opened");
    // Waits without a limit: a holder writes one line and goes.
    flock(descriptor_, LOCK_EX);
  }
  ~Lock() { ::close(descriptor_); }
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

 private:
  const int descriptor_;
};

/// One write() in append mode: lines of several programs do not mix.
/// The size is asked and the file renamed under the lock: two programs that rotate at the same time
/// would lose a file. A line that does not fit begins a new file, so that none is ever larger than
/// the limit, unless a single line is.
void append(const Log& log, const std::string& line) {
  const Lock lock(log.file.string() + ".lock");
  if (file_size_or_zero(log.file) + line.size() > log.limits.bytes) rotate(log);
  const int descriptor = ::open(log.file.c_str(), O_CREAT | O_WRONLY | O_APPEND | O_CLOEXEC, 0644);
  if (descriptor < 0) throw std::runtime_error(log.file.string() + ": cannot be opened");
  const bool whole =
      ::write(descriptor, line.data(), line.size()) == static_cast<ssize_t>(line.size());
  ::close(descriptor);
  if (!whole) throw std::runtime_error(log.file.string() + ": cannot be written");
}

/// Time, process and the text without control characters: one event is one line.
/// Escape sequences and line ends from a device or a script could otherwise forge lines of the log,
/// or act on the terminal that shows it. Bytes from 0x80 on stay: they are UTF-8.
std::string one_line(const std::string& text) {
  std::string line = wall_time_text() + " [" + std::to_string(getpid()) + "] ";
  for (const char c : text) line += static_cast<unsigned char>(c) < 0x20 || c == 0x7F ? ' ' : c;
  return line + "\n";
}

}  // namespace

// The whole path, so that the log stays where it is when the program changes its folder.
void open_log(const fs::path& given, const LogLimits& limits) {
  Log& log = the_log();
  const std::lock_guard guard(log.mutex);
  log.file.clear();  // stays so where the new one cannot be opened
  const fs::path file = fs::absolute(given);
  fs::create_directories(file.parent_path());
  // Taken and given back: a folder that cannot be written is an error now, to the one who asked,
  // and not a lost line later.
  { const Lock lock(file.string() + ".lock"); }
  log.file = file;
  log.limits = limits;
  log.complained = false;
}

void close_log() noexcept {
  const std::lock_guard guard(the_log().mutex);
  the_log().file.clear();
}

fs::path default_log() {
  if (const char* const given = std::getenv("VITREO_LOG"); given != nullptr && *given) return given;
  const fs::path folder = state_folder();
  return folder.empty() ? folder : folder / "host.log";
}

// Nothing escapes: a run must not end because the disk of the log is full. One complaint, not one a
// line.
void write_log(const std::string& text) noexcept {
  Log& log = the_log();
  const std::lock_guard guard(log.mutex);
  if (log.file.empty()) return;
  try {
    append(log, one_line(text));
  } catch (const std::exception& error) {
    if (!log.complained) std::cerr << "vitreo: log: " << error.what() << "\n";
    log.complained = true;
  }
}

}  // namespace vitreo
