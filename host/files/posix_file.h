// Files by descriptor, for data that must reach the disk in a certain order. Errors throw
// std::runtime_error naming the file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace vitreo {

/// Owns a descriptor and closes it; a negative one owns nothing.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  ~Descriptor();
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int number() const { return number_; }

 private:
  int number_;
};

int create_new_file(const std::filesystem::path& file);     // must not be there yet
int open_existing_file(const std::filesystem::path& file);  // to read and write
void close_file(int& descriptor) noexcept;                  // -1 is none
inline void close_file(const int& descriptor) noexcept {
  int copy = descriptor;
  close_file(copy);
}
void write_at(int descriptor, std::uint64_t offset, std::string_view bytes,
              const std::filesystem::path& file);
/// All of it or, after an error, nothing of it.
void append_whole(int descriptor, std::string_view bytes, const std::filesystem::path& file);
void shorten_file(int descriptor, std::uint64_t size) noexcept;
void sync_file(int descriptor, const std::filesystem::path& file);
void sync_folder(const std::filesystem::path& folder);
std::string read_whole_file(const std::filesystem::path& file);
void read_at(const std::filesystem::path& file, std::uint64_t offset, void* into,
             std::size_t bytes);
std::uint64_t file_size_or_zero(const std::filesystem::path& file) noexcept;

}  // namespace vitreo
