// SPDX-License-Identifier: Apache-2.0
#include "host/files/tiff_stack.h"

#include "host/files/posix_file.h"

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

// Types of a directory's entry.
constexpr std::uint32_t kByteType = 1;
constexpr std::uint32_t kTextType = 2;
constexpr std::uint32_t kShortType = 3;
constexpr std::uint32_t kLongType = 4;
constexpr std::uint32_t kRationalType = 5;

// TIFF's 32 bits, less room for what stands behind the pixels.
constexpr std::uint64_t kTiffLargest = 0xFFFFFFFF - (64u << 20);
constexpr std::uint64_t kRoomOfAPage = 1024;  // for its directory and label
constexpr std::uint64_t kTiffHead = 8;

/// Little-endian.
std::string u16(std::uint32_t value) {
  return {static_cast<char>(value & 0xFF), static_cast<char>(value >> 8 & 0xFF)};
}
std::string u32(std::uint64_t value) {
  return u16(static_cast<std::uint32_t>(value & 0xFFFF)) +
         u16(static_cast<std::uint32_t>(value >> 16));
}

/// Entries of one directory, to be added in the ascending order of their tags.
class Directory {
 public:
  /// A value of up to four bytes stands in place of its offset.
  void add(std::uint32_t tag, std::uint32_t type, std::uint64_t count, std::uint64_t value) {
    entries_ += u16(tag) + u16(type) + u32(count) + u32(value);
    ++count_;
  }
  std::string text(std::uint64_t next) const { return u16(count_) + entries_ + u32(next); }

 private:
  std::uint32_t count_ = 0;
  std::string entries_;
};
/// TIFF 6.0, section 2: how many entries, 12 bytes each, and the place of the next directory.
constexpr std::uint64_t directory_bytes(int entries) {
  return 2 + static_cast<std::uint64_t>(entries) * 12 + 4;
}
constexpr int kPageEntries = 13;       // of every page
constexpr int kFirstPageEntries = 16;  // description, and ImageJ's two, of the first alone

/// What stands behind the pixels and before the directories, each part at an even place.
struct Tail {
  std::uint64_t begin = 0;
  std::string bytes{};
  std::uint64_t add(const std::string& part) {
    const std::uint64_t at = begin + bytes.size();
    bytes += part;
    if (bytes.size() % 2 == 1) bytes += '\0';
    return at;
  }
};

/// UTF-16, little-endian, of UTF-8; what is beyond its first plane or broken becomes U+FFFD.
std::string utf16(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size();) {
    const auto byte = [&](std::size_t at) {
      return at < text.size() ? static_cast<unsigned char>(text[at]) : 0U;
    };
    const unsigned lead = byte(i);
    unsigned letter = 0xFFFD;
    std::size_t length = 1;
    if (lead < 0x80) {
      letter = lead;
    } else if (lead >> 5 == 6 && byte(i + 1) >> 6 == 2) {
      letter = (lead & 0x1F) << 6 | (byte(i + 1) & 0x3F);
      length = 2;
    } else if (lead >> 4 == 14 && byte(i + 1) >> 6 == 2 && byte(i + 2) >> 6 == 2) {
      letter = (lead & 0xF) << 12 | (byte(i + 1) & 0x3F) << 6 | (byte(i + 2) & 0x3F);
      length = 3;
    }
    out += u16(letter);
    i += length;
  }
  return out;
}

/// ImageJ's own block (ij.io.TiffEncoder): a magic number, the kind "labl" and how many of it, then
/// the labels; and the sizes of these parts, which a tag of its own has.
struct Labels {
  std::string block;
  std::string sizes;
  std::uint64_t parts = 0;
};
Labels labels_of(const TiffStack& stack) {
  constexpr std::uint64_t kImageJMagic = 0x494A494A;  // "IJIJ"
  constexpr std::uint64_t kLabelKind = 0x6C61626C;    // "labl"
  Labels made;
  made.block = u32(kImageJMagic) + u32(kLabelKind) + u32(stack.labels.size());
  made.sizes = u32(made.block.size());
  for (const std::string& label : stack.labels) {
    const std::string text = utf16(label);
    made.block += text;
    made.sizes += u32(text.size());
  }
  made.parts = stack.labels.size() + 1;
  return made;
}

/// Places in the tail to which the directories refer.
struct Places {
  std::uint64_t description = 0;
  std::uint64_t bits = 0;
  std::uint64_t largest = 0;
  std::uint64_t resolution = 0;
  std::uint64_t label_sizes = 0;
  std::uint64_t labels = 0;
};

/// Tags: 256 width, 257 height, 258 bits a sample, 259 compression (1: none), 262 photometric (1:
/// black is 0, 2: RGB), 270 description, 273 strip offset, 277 samples a pixel, 278 rows a strip,
/// 279 strip bytes, 281 the largest sample that there can be, 282 and 283 resolution, 296 its unit
/// (1: none but as the description says, 3: cm), 50838 and 50839 ImageJ's labels.
std::string page(const TiffStack& stack, const Places& at, bool first, const Labels& labels,
                 std::uint64_t pixels_at, std::uint64_t next) {
  const bool rgb = stack.samples == 3;
  const auto samples = static_cast<std::uint64_t>(stack.samples);
  Directory directory;
  directory.add(256, kLongType, 1, static_cast<std::uint64_t>(stack.width_px));
  directory.add(257, kLongType, 1, static_cast<std::uint64_t>(stack.height_px));
  directory.add(258, kShortType, samples, rgb ? at.bits : static_cast<std::uint64_t>(stack.bits));
  directory.add(259, kShortType, 1, 1);
  directory.add(262, kShortType, 1, rgb ? 2 : 1);
  if (first) directory.add(270, kTextType, stack.description.size() + 1, at.description);
  directory.add(273, kLongType, 1, pixels_at);
  directory.add(277, kShortType, 1, samples);
  directory.add(278, kLongType, 1, static_cast<std::uint64_t>(stack.height_px));
  directory.add(279, kLongType, 1, stack.page_bytes());
  directory.add(281, kShortType, samples, rgb ? at.largest : (1U << stack.significant_bits) - 1);
  directory.add(282, kRationalType, 1, at.resolution);
  directory.add(283, kRationalType, 1, at.resolution);
  directory.add(296, kShortType, 1, stack.labels.empty() && stack.pixel > 0 ? 3 : 1);
  if (first && !stack.labels.empty()) {
    directory.add(50838, kLongType, labels.parts, at.label_sizes);
    directory.add(50839, kByteType, labels.block.size(), at.labels);
  }
  return directory.text(next);
}

/// Pixels per unit, a fraction of two 32-bit numbers: per um, which ImageJ's description names, or
/// per cm, which TIFF itself knows.
std::string resolution_of(const TiffStack& stack) {
  if (!(stack.pixel > 0)) return u32(1) + u32(1);
  const double unit = stack.labels.empty() ? 1e-2 : 1e-6;  // m
  constexpr double kScale = 1e6;
  const double per_unit = unit / stack.pixel;
  // The larger of the two numbers is kept in range.
  return per_unit > 1 ? u32(static_cast<std::uint64_t>(std::llround(per_unit * 1e3))) + u32(1000)
                      : u32(static_cast<std::uint64_t>(kScale)) +
                            u32(static_cast<std::uint64_t>(std::llround(kScale / per_unit)));
}

}  // namespace

std::uint64_t TiffStack::page_bytes() const {
  return static_cast<std::uint64_t>(width_px) * static_cast<std::uint64_t>(height_px) *
         static_cast<std::uint64_t>(samples * bits / 8);
}

std::size_t tiff_capacity(const TiffStack& stack) {
  return std::max<std::size_t>(1, kTiffLargest / (stack.page_bytes() + kRoomOfAPage));
}

void write_tiff_stack(const std::filesystem::path& file, const TiffStack& stack, std::size_t pages,
                      const std::function<std::string_view(std::size_t)>& pixels) {
  const Labels labels = stack.labels.empty() ? Labels{} : labels_of(stack);
  // Rounded up to even, where TIFF wants what it refers to.
  const std::uint64_t size = stack.page_bytes();
  Tail tail{kTiffHead + (pages * size + 1) / 2 * 2};
  Places at;
  // A text of TIFF ends with a NUL, which counts.
  at.description = tail.add(stack.description + '\0');
  at.bits = tail.add(u16(8) + u16(8) + u16(8));
  at.largest = tail.add(u16(255) + u16(255) + u16(255));
  at.resolution = tail.add(resolution_of(stack));
  at.label_sizes = tail.add(labels.sizes);
  at.labels = tail.add(labels.block);
  const std::uint64_t first_at = tail.begin + tail.bytes.size();
  const Descriptor out(create_new_file(file));
  // "II", little-endian, and TIFF's 42.
  write_at(out.number(), 0, u16(0x4949) + u16(42) + u32(first_at), file);
  std::string directories;
  for (std::size_t i = 0; i < pages; ++i) {
    const std::uint64_t place = kTiffHead + i * size;
    // As they come: no more than a page of pixels is in memory.
    write_at(out.number(), place, pixels(i), file);
    const int entries = i > 0                  ? kPageEntries
                        : stack.labels.empty() ? kPageEntries + 1
                                               : kFirstPageEntries;
    const std::uint64_t next = first_at + directories.size() + directory_bytes(entries);
    // The last one has 0 for the next.
    directories += page(stack, at, i == 0, labels, place, i + 1 < pages ? next : 0);
  }
  write_at(out.number(), tail.begin, tail.bytes + directories, file);
}

}  // namespace vitreo
