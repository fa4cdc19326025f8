// SPDX-License-Identifier: Apache-2.0
#include "host/files/published_file.h"

#include "host/files/posix_file.h"
#include "host/files/run_folder.h"

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& file, int error) {
  const bool linkless = error == EPERM || error == EOPNOTSUPP || error == ENOSYS;
  throw std::runtime_error(
      file.string() + ": " + std::strerror(error) +
      (linkless ? " (the folder's file system has no hard links, which marks of a sweep need: "
                  "choose another one)"
                : ""));
}

/// A file of a name of its own, in the same folder, whole and on the disk; it goes with
/// the scope.
/// After a kill it stays: the name begins with a dot, and readers pass it by.
class Draft {
 public:
  Draft(const fs::path& file, std::string_view bytes)
      : name_(file.parent_path() / ("." + file.filename().string() + "." + random_hex(12))) {
    const Descriptor made(create_new_file(name_));
    try {
      append_whole(made.number(), bytes, name_);
      sync_file(made.number(), name_);
    } catch (...) {
      ::unlink(name_.c_str());
      throw;
    }
  }
  ~Draft() { ::unlink(name_.c_str()); }
  Draft(const Draft&) = delete;
  Draft& operator=(const Draft&) = delete;
  const fs::path& name() const { return name_; }

 private:
  fs::path name_;
};

}  // namespace

// link(2) is the one call that is atomic on every version of NFS. Its answer may be lost on the
// way, so that a retry reports EEXIST for a link that this process made: the number of links of the
// draft decides, as open(2) of Linux advises.
bool publish_new(const fs::path& file, std::string_view bytes) {
  const Draft draft(file, bytes);
  const int result = ::link(draft.name().c_str(), file.c_str());
  // Kept: stat() may set another one.
  const int error = errno;
  struct stat about {};
  const bool linked =
      result == 0 || (::stat(draft.name().c_str(), &about) == 0 && about.st_nlink == 2);
  if (!linked && error != EEXIST) fail(file, error);
  if (linked) sync_folder(file.parent_path());
  return linked;
}

// rename(2) replaces at once on every file system.
void publish(const fs::path& file, std::string_view bytes) {
  const Draft draft(file, bytes);
  if (::rename(draft.name().c_str(), file.c_str()) != 0) fail(file, errno);
  sync_folder(file.parent_path());
}

}  // namespace vitreo
