// Byte strings of saved models: little-endian, with a checksum; read back exactly or refused.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

namespace vitreo::vision {

/// FNV-1a of 64 bits (Fowler, Noll & Vo): against damage, not against malice.
inline std::uint64_t checksum_of(std::string_view bytes) {
  std::uint64_t sum = 14695981039346656037ULL;
  for (const char c : bytes) sum = (sum ^ static_cast<unsigned char>(c)) * 1099511628211ULL;
  return sum;
}

class ByteWriter {
 public:
  void text(std::string_view bytes) { bytes_ += bytes; }
  void number(std::uint64_t value, int size) {
    for (int k = 0; k < size; ++k)
      bytes_ += static_cast<char>(static_cast<unsigned char>(value >> (8 * k)));
  }
  void u8(std::uint8_t value) { number(value, 1); }
  void u32(std::uint32_t value) { number(value, 4); }
  void f32(float value) { number(std::bit_cast<std::uint32_t>(value), 4); }
  void f64(double value) { number(std::bit_cast<std::uint64_t>(value), 8); }
  /// The bytes and, last, their checksum.
  std::string sealed() const {
    ByteWriter end;
    end.number(checksum_of(bytes_), 8);
    return bytes_ + end.bytes_;
  }

 private:
  std::string bytes_;
};

/// Every method throws std::invalid_argument, naming `what`, where the bytes end early or hold no
/// such value.
class ByteReader {
 public:
  /// Checks the first four letters, the version after them and the checksum at the end.
  ByteReader(std::string_view bytes, std::string_view magic, std::uint32_t version,
             std::string what)
      : what_(std::move(what)) {
    if (bytes.size() < magic.size() + 12 || bytes.substr(0, magic.size()) != magic)
      fail("is not such a file");
    rest_ = bytes.substr(magic.size(), 4);
    if (const std::uint32_t found = u32(); found != version)
      fail("has version " + std::to_string(found));
    rest_ = bytes.substr(bytes.size() - 8);
    if (number(8) != checksum_of(bytes.substr(0, bytes.size() - 8)))
      fail("is damaged: its check sum is wrong");
    rest_ = bytes.substr(magic.size() + 4, bytes.size() - magic.size() - 12);
  }
  [[noreturn]] void fail(const std::string& why) const {
    throw std::invalid_argument(what_ + ": " + why);
  }
  std::string_view text(std::size_t size) {
    if (rest_.size() < size) fail("ends too early");
    const std::string_view taken = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return taken;
  }
  std::uint64_t number(int size) {
    const std::string_view bytes = text(static_cast<std::size_t>(size));
    std::uint64_t value = 0;
    for (int k = size - 1; k >= 0; --k)
      value = value << 8 | static_cast<unsigned char>(bytes[static_cast<std::size_t>(k)]);
    return value;
  }
  std::uint32_t u32() { return static_cast<std::uint32_t>(number(4)); }
  int integer(int low, int high) {
    const std::uint32_t value = u32();
    if (value > static_cast<std::uint32_t>(high) || static_cast<int>(value) < low)
      fail("holds a number out of range");
    return static_cast<int>(value);
  }
  float f32(float low, float high) { return checked(std::bit_cast<float>(u32()), low, high); }
  double f64(double low, double high) {
    return checked(std::bit_cast<double>(number(8)), low, high);
  }
  void end() const {
    if (!rest_.empty()) fail("is longer than it should be");
  }

 private:
  template <class Float>
  Float checked(Float value, Float low, Float high) const {
    // Written so that NaN fails too.
    if (!(value >= low && value <= high)) fail("holds a number out of range");
    return value;
  }
  std::string what_;
  std::string_view rest_;
};

}  // namespace vitreo::vision
