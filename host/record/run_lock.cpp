// SPDX-License-Identifier: Apache-2.0
#include "host/record/run_lock.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <stdexcept>
#include <string>
#include <sys/file.h>
#include <unistd.h>

namespace vitreo {
namespace {

// A file of its own and not run.sqlite: SQLite locks that one, and closing any descriptor of a file
// takes the process' POSIX locks on it away.
std::filesystem::path lock_file(const std::filesystem::path& folder) {
  return folder / "recording.lock";
}

}  // namespace

// flock (BSD) belongs to the open file: it excludes other parts of this process, too, which a POSIX
// record lock would not, and goes with the process.
RunLock::RunLock(const std::filesystem::path& folder) : file_(lock_file(folder)) {
  descriptor_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (descriptor_ < 0) throw std::runtime_error(file_.string() + ": " + std::strerror(errno));
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) == 0) return;
  ::close(descriptor_);
  descriptor_ = -1;
  throw std::runtime_error(folder.string() + ": is being recorded by a program that still runs");
}

RunLock::~RunLock() { release(); }

// The name goes first, while the lock is held: removed later, it could be that of another process
// which took the lock in between.
void RunLock::release() noexcept {
  if (descriptor_ < 0) return;
  std::error_code ignored;  // where it stays, it is not held
  std::filesystem::remove(file_, ignored);
  ::close(descriptor_);
  descriptor_ = -1;
}

// Takes a shared lock for a moment, without waiting; two programs that ask at the same time do not
// exclude each other. Within that moment a RunLock of the folder would fail; it lasts two system
// calls.
bool RunLock::is_held(const std::filesystem::path& folder) {
  const int descriptor = ::open(lock_file(folder).c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return false;
  const bool held = ::flock(descriptor, LOCK_SH | LOCK_NB) != 0;
  ::close(descriptor);
  return held;
}

}  // namespace vitreo
