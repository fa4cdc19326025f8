// SPDX-License-Identifier: Apache-2.0
#include "host/files/posix_file.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <stdexcept>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo {
namespace {

// Reads errno, so it must come right after the call that failed.
[[noreturn]] void fail(const std::filesystem::path& file) {
  throw std::runtime_error(file.string() + ": " + std::strerror(errno));
}

// Close-on-exec: a child process such as ffmpeg that inherited the record's files would keep them,
// and a run's lock, beyond the end of this program. The rights 0666 are narrowed by the umask.
int opened(const std::filesystem::path& file, int flags) {
  const int descriptor = ::open(file.c_str(), flags | O_CLOEXEC, 0666);
  if (descriptor < 0) fail(file);
  return descriptor;
}

}  // namespace

Descriptor::~Descriptor() {
  if (number_ >= 0) ::close(number_);
}

// O_EXCL: a stack or an index that is there already belongs to another run; writing into it would
// mix two runs in one file.
int create_new_file(const std::filesystem::path& file) {
  return opened(file, O_RDWR | O_CREAT | O_EXCL);
}
int open_existing_file(const std::filesystem::path& file) { return opened(file, O_RDWR); }

void close_file(int& descriptor) noexcept {
  if (descriptor >= 0) ::close(descriptor);
  descriptor = -1;
}

// One pwrite() may take less than it was given: on a disk that is nearly full, or beyond 2 GB. The
// next call then continues, or gives the error. pwrite() moves no file position, so that the head's
// link can be set while pages are appended.
void write_at(int descriptor, std::uint64_t offset, std::string_view bytes,
              const std::filesystem::path& file) {
  while (!bytes.empty()) {
    const ssize_t written =
        ::pwrite(descriptor, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail(file);
    bytes.remove_prefix(static_cast<std::size_t>(written));
    offset += static_cast<std::uint64_t>(written);
  }
}

// A write that fails half-way is cut off again, so that the file ends with a whole record.
void append_whole(int descriptor, std::string_view bytes, const std::filesystem::path& file) {
  const off_t end = ::lseek(descriptor, 0, SEEK_END);
  try {
    write_at(descriptor, static_cast<std::uint64_t>(end), bytes, file);
  } catch (const std::exception&) {
    shorten_file(descriptor, static_cast<std::uint64_t>(end));
    throw;
  }
}

void shorten_file(int descriptor, std::uint64_t size) noexcept {
  // Where even this fails the file keeps some bytes that nothing refers to.
  static_cast<void>(::ftruncate(descriptor, static_cast<off_t>(size)) == 0);
}

// fdatasync() waits for the bytes and for the size that is needed to read them, but not for the
// time stamps as fsync() does.
void sync_file(int descriptor, const std::filesystem::path& file) {
  if (::fdatasync(descriptor) != 0) fail(file);
}

// A new name is durable only when its folder is.
void sync_folder(const std::filesystem::path& folder) {
  const Descriptor reading(opened(folder, O_RDONLY));
  if (::fsync(reading.number()) != 0 && errno != EINVAL) fail(folder);  // some file systems cannot
}

std::string read_whole_file(const std::filesystem::path& file) {
  const Descriptor reading(opened(file, O_RDONLY));
  // The size of a pipe or a device says nothing: only plain files are read as a whole.
  struct stat status {};
  if (::fstat(reading.number(), &status) != 0) fail(file);
  if (!S_ISREG(status.st_mode)) throw std::runtime_error(file.string() + ": is not a file");
  std::string text(static_cast<std::size_t>(status.st_size), '\0');
  read_at(file, 0, text.data(), text.size());
  return text;
}

void read_at(const std::filesystem::path& file, std::uint64_t offset, void* into,
             std::size_t bytes) {
  const Descriptor reading(opened(file, O_RDONLY));
  auto* at = static_cast<char*>(into);
  // Early end of the file: another program shortens it, or an index claims more than there is.
  while (bytes > 0) {
    const ssize_t got = ::pread(reading.number(), at, bytes, static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail(file);
    if (got == 0) throw std::runtime_error(file.string() + ": is shorter than it should be");
    at += got;
    offset += static_cast<std::uint64_t>(got);
    bytes -= static_cast<std::size_t>(got);
  }
}

// For comparisons only: a file that is missing holds nothing, whatever the reason.
std::uint64_t file_size_or_zero(const std::filesystem::path& file) noexcept {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  return error ? 0 : size;
}

}  // namespace vitreo
