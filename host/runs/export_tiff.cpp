// TIFF export: an ImageJ stack, all pixels in one piece behind the head, as ImageJ reads them, then
// the page directories for other readers (TIFF 6.0).
// SPDX-License-Identifier: Apache-2.0
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"
#include "host/runs/export.h"
#include "host/runs/run_reader.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace vitreo {
namespace {

// TIFF's 32 bits, less room for the pages' directories.
constexpr std::uint64_t kLargest = 0xFFFFFFFF - (16u << 20);
// Bytes of a directory: its count, twelve for each entry, the offset of the next.
constexpr std::uint32_t kEntries = 14;
constexpr std::uint32_t kDirectory = 2 + kEntries * 12 + 4;

/// Little-endian.
std::string u16(std::uint32_t value) {
  return {static_cast<char>(value & 0xFF), static_cast<char>(value >> 8 & 0xFF)};
}
std::string u32(std::uint64_t value) {
  return u16(static_cast<std::uint32_t>(value & 0xFFFF)) +
         u16(static_cast<std::uint32_t>(value >> 16));
}
/// An entry of a directory. A value of up to four bytes stands in place of its offset.
std::string tag(std::uint32_t id, std::uint32_t type, std::uint64_t count, std::uint64_t value) {
  return u16(id) + u16(type) + u32(count) + u32(value);
}

/// What stands behind the pixels: description; bits and the largest value of three samples;
/// resolution; then the directories.
/// All pages share it: their frames are of one size and kind (frames_of()).
struct Tail {
  std::uint64_t at;
  std::string description;
  std::string bits;
  std::string resolution;
  int significant;  // bits of a sample that count, the low ones
  std::uint64_t bits_at() const { return at + description.size(); }
  std::uint64_t largest_at() const { return bits_at() + bits.size() / 2; }
  std::uint64_t resolution_at() const { return bits_at() + bits.size(); }
  std::uint64_t pages_at() const { return resolution_at() + resolution.size(); }
};

/// The directory of one page, in the ascending order of tags that TIFF asks for: 256 width, 257
/// height, 258 bits a sample, 259 compression (1: none), 262 photometric (1: black is 0, 2: RGB),
/// 270 description, 273 strip offset, 277 samples a pixel, 278 rows a strip, 279 strip bytes, 281
/// the largest sample that there can be (of color for each of the three), 282 and 283 resolution,
/// 296 its unit (1: none; ImageJ reads it from the description).
std::string page(const FrameRow& first, const Tail& tail, std::uint64_t pixels_at,
                 std::uint64_t next) {
  const bool rgb = first.pixel_type == 2;
  constexpr std::uint32_t kText = 2;
  constexpr std::uint32_t kShort = 3;
  constexpr std::uint32_t kLong = 4;
  constexpr std::uint32_t kRational = 5;
  return u16(kEntries) + tag(256, kLong, 1, first.width_px) + tag(257, kLong, 1, first.height_px) +
         tag(258, kShort, rgb ? 3 : 1,
             rgb                     ? tail.bits_at()
             : first.pixel_type == 1 ? 16
                                     : 8) +
         tag(259, kShort, 1, 1) + tag(262, kShort, 1, rgb ? 2 : 1) +
         tag(270, kText, tail.description.size(), tail.at) + tag(273, kLong, 1, pixels_at) +
         tag(277, kShort, 1, rgb ? 3 : 1) + tag(278, kLong, 1, first.height_px) +
         tag(279, kLong, 1, first.bytes) +
         tag(281, kShort, rgb ? 3 : 1, rgb ? tail.largest_at() : (1U << tail.significant) - 1) +
         tag(282, kRational, 1, tail.resolution_at()) +
         tag(283, kRational, 1, tail.resolution_at()) + tag(296, kShort, 1, 1) + u32(next);
}

/// ImageJ's own keys. Ended by a zero, as TIFF's texts are, and of even length.
/// ImageJ reads the first directory alone: by "images" it knows how many pictures follow it without
/// a gap. `max` is the range of gray that it shows: of 12 bits in 16 all would be black. Times in
/// s, the unit in ASCII, which TIFF's texts are.
std::string description_of(const RecordedCameraInfo& camera, std::size_t count, int bits) {
  std::string text = fmt::format(
      "ImageJ=1.53t\nimages={0}\nframes={0}\nhyperstack=true\nmode=grayscale\nunit=um\nfinterval={"
      "1}\nfps={2}\nmin=0\nmax={3}\n",
      count, camera.frame_period * camera.every,
      camera.frame_period > 0 ? 1 / (camera.frame_period * camera.every) : 0, (1U << bits) - 1);
  text += '\0';
  if (text.size() % 2 == 1) text += '\0';
  return text;
}

void write_stack(const RunData& data, const RecordedCameraInfo& camera, const FrameRow* const* rows,
                 std::size_t count, const std::filesystem::path& file) {
  const FrameRow& first = *rows[0];
  // Rounded up to even, where TIFF wants its directories; the head has 8 bytes.
  const std::uint64_t pixels_end = 8 + (count * first.bytes + 1) / 2 * 2;
  // Resolution as pixels per micrometer, a fraction of two 32-bit numbers.
  const double pixel_um = camera.effective_pixel > 0 ? camera.effective_pixel * 1e6 : 1;
  // A record that does not say how many bits count leaves all 16.
  const int bits = first.pixel_type != 1 ? 8 : camera.bits > 8 ? camera.bits : 16;
  const Tail tail{pixels_end, description_of(camera, count, bits),
                  u16(8) + u16(8) + u16(8) + u16(0) + u16(255) + u16(255) + u16(255) + u16(0),
                  u32(1000000) + u32(static_cast<std::uint64_t>(std::lround(pixel_um * 1e6))),
                  bits};
  const std::filesystem::path part = file.string() + ".part";
  std::error_code ignored;  // of an export that was broken off
  std::filesystem::remove(part, ignored);
  const int out = create_new_file(part);
  try {
    // "II", little-endian, and TIFF's 42.
    write_at(out, 0, u16(0x4949) + u16(42) + u32(tail.pages_at()), part);
    std::string pages;
    for (std::size_t i = 0; i < count; ++i) {
      cv::Mat image = read_frame(data, *rows[i]);
      if (first.pixel_type == 2) cv::cvtColor(image, image, cv::COLOR_BGR2RGB);
      const std::uint64_t at = 8 + i * first.bytes;
      write_at(out, at, {reinterpret_cast<const char*>(image.data), first.bytes}, part);
      pages += page(first, tail, at, i + 1 < count ? tail.pages_at() + (i + 1) * kDirectory : 0);
    }
    write_at(out, pixels_end, tail.description + tail.bits + tail.resolution + pages, part);
  } catch (const std::exception&) {
    close_file(out);
    throw;
  }
  close_file(out);
  std::filesystem::rename(part, file);
}

}  // namespace

Files export_tiff(const RunData& data, const std::filesystem::path& folder) {
  Files files;
  for (const RecordedCameraInfo& camera : data.cameras) {
    const std::vector<const FrameRow*> rows = frames_of(data, camera.camera);
    if (rows.empty()) continue;
    // How many frames fit below 4 GB together with their directories.
    const std::size_t in_one = std::max<std::size_t>(1, kLargest / (rows[0]->bytes + kDirectory));
    for (std::size_t from = 0, number = 0; from < rows.size(); from += in_one, ++number) {
      const std::string name = slug(camera.camera, "camera") +
                               (number == 0 ? "" : "_" + std::to_string(number)) + ".tif";
      write_stack(data, camera, rows.data() + from, std::min(in_one, rows.size() - from),
                  folder / name);
      files.push_back(folder / name);
    }
  }
  return files;
}

}  // namespace vitreo
