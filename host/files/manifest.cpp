// SPDX-License-Identifier: Apache-2.0
#include "host/files/manifest.h"

#include "host/files/digest.h"
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <map>
#include <sstream>
#include <stdexcept>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo {
namespace {

/// Whether the file is part of the record: not the manifest itself, not the files of a run that is
/// being written, not exports. The index of SQLite's write-ahead log holds marks of its readers,
/// and nothing that the log itself does not say.
bool belongs(const std::string& name) {
  return name != kManifest && name != "recording.lock" && name != "reserve.room" &&
         name != "run.sqlite-shm" && !name.starts_with("export/");
}

// Paths with '/' below the run's folder, sorted: the manifest of the same files is the same text
// everywhere. Links to folders are not entered.
std::vector<std::string> files_of(const std::filesystem::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    std::string below = entry.path().lexically_relative(folder).generic_string();
    if (!entry.is_directory() && belongs(below)) names.push_back(std::move(below));
  }
  std::sort(names.begin(), names.end());
  return names;
}

// A line is 64 hexadecimal digits, two spaces (the mark of `sha256sum` for text mode) and the name.
// What is no such line is an error and not passed over: a damaged manifest must not vouch for a
// run.
std::map<std::string, std::string> read_manifest(const std::filesystem::path& folder) {
  std::istringstream lines(read_whole_file(folder / kManifest));
  std::map<std::string, std::string> hashes;
  for (std::string line; std::getline(lines, line);) {
    if (line.size() < 67 || line.substr(64, 2) != "  ")
      throw std::runtime_error((folder / kManifest).string() +
                               ": has a line that is no hash and name");
    if (belongs(line.substr(66))) hashes[line.substr(66)] = line.substr(0, 64);
  }
  return hashes;
}

}  // namespace

// O_NOFOLLOW: a link could name a file outside of the run, which may change without the run.
std::string sha256_file(const std::filesystem::path& file) {
  const Descriptor open(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
  if (open.number() < 0) throw std::runtime_error(file.string() + ": " + std::strerror(errno));
  struct stat status {};
  if (::fstat(open.number(), &status) != 0 || !S_ISREG(status.st_mode))
    throw std::runtime_error(file.string() + ": cannot be read as a file");
  // Read in parts, not mapped: a file that another program shortens meanwhile then has another
  // hash, where a mapping would raise SIGBUS.
  Sha256 digest;
  std::vector<char> part(std::size_t{1} << 20);
  for (;;) {
    const ssize_t count = ::read(open.number(), part.data(), part.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw std::runtime_error(file.string() + ": " + std::strerror(errno));
    if (count == 0) return digest.hex();
    digest.update({part.data(), static_cast<std::size_t>(count)});
  }
}

std::size_t count_files(const std::filesystem::path& folder) { return files_of(folder).size(); }

// Last of a run's files, when nothing else is written any more. The manifest cannot hash itself:
// who needs proof of it keeps its hash elsewhere.
void write_manifest(const std::filesystem::path& folder) {
  std::string text;
  for (const std::string& name : files_of(folder))
    text += sha256_file(folder / name) + "  " + name + "\n";
  write_file(folder / kManifest, text);
}

// Both ways: each file that is there must be known and unchanged, and each that is known must be
// there. A folder without a manifest is a finding and no error: the run was never closed.
std::vector<std::string> check_manifest(const std::filesystem::path& folder) {
  if (!std::filesystem::exists(folder / kManifest))
    return {std::string(kManifest) + ": is missing"};
  std::map<std::string, std::string> expected = read_manifest(folder);
  std::vector<std::string> problems;
  for (const std::string& name : files_of(folder)) {
    const auto known = expected.find(name);
    if (known == expected.end()) {
      problems.push_back(name + ": was not there when the run was closed");
      continue;
    }
    if (sha256_file(folder / name) != known->second)
      problems.push_back(name + ": has changed since the run was closed");
    expected.erase(known);
  }
  for (const auto& [name, hash] : expected) problems.push_back(name + ": is missing");
  return problems;
}

}  // namespace vitreo
