// SPDX-License-Identifier: Apache-2.0
#include "host/files/ndtiff.h"

#include "host/files/posix_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <stdexcept>

namespace vitreo {
namespace {

static_assert(std::endian::native == std::endian::little,
              "the files are written as this machine has its numbers");

constexpr int kEntries = 13;              // tags a page
constexpr std::uint64_t kHeadLink = 4;    // where a file's head has the first page's offset
constexpr std::uint64_t kHeadBytes = 28;  // in front of the summary, the last 4 are its length
constexpr const char* kStackName = "_NDTiffStack";
constexpr std::uint32_t kLinkBytes = 4;  // the next page's offset, in front of the small values
// Head of the file, directory of a page (count, tags, link) and two resolutions: no pixels begin
// before.
constexpr std::uint64_t kSmallestHead = kHeadBytes + 2 + kEntries * 12 + kLinkBytes + 16;
// Marks of NDTiff in the file's head (NDStorage, "NDTiff file format").
constexpr std::uint32_t kMagic = 483729;
constexpr std::uint32_t kSummary = 2355492;
constexpr std::uint32_t kMajor = 3;
constexpr std::uint32_t kMinor = 3;

// Little-endian bytes of a head, a directory or an index entry. Offsets are kept in 64 bits and cut
// to 32 here: NdtiffWriter begins a new file before one passes kLargestFile.
class Bytes {
 public:
  Bytes& u16(std::uint32_t value) { return add(static_cast<std::uint16_t>(value)); }
  Bytes& u32(std::uint64_t value) { return add(static_cast<std::uint32_t>(value)); }
  // 32-bit length in bytes, then the text without an end mark, as NDTiff has its strings.
  Bytes& text(const std::string& value) {
    u32(value.size());
    bytes_ += value;
    return *this;
  }
  /// A tag of one value.
  Bytes& tag(std::uint32_t id, std::uint32_t type, std::uint64_t count, std::uint64_t value) {
    return u16(id).u16(type).u32(count).u32(value);
  }
  std::string& str() { return bytes_; }

 private:
  template <class Number>
  Bytes& add(Number value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  std::string bytes_;
};

// NDTiff's numbers of the types that a camera of this host may give; others are refused before a
// byte is written.
int pixel_type_of(const cv::Mat& image) {
  if (!image.empty() && image.dims == 2) {
    if (image.type() == CV_8UC1) return 0;
    if (image.type() == CV_16UC1) return 1;
    if (image.type() == CV_8UC3) return 2;
  }
  throw std::invalid_argument(
      "a recorded frame must be 8- or 16-bit gray or 8-bit color, and not empty");
}

// ASCII with \u escapes: NDTiff wants UTF-8 and a text of TIFF 7-bit ASCII, and this is both. What
// is no UTF-8 is replaced, so that a camera's odd name ends no run.
std::string text_of(const nlohmann::json& json) {
  return json.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

struct DeepType {
  std::uint32_t number;
  int bits;
};
// NDStorage's numbers of 16-bit pixels of which fewer bits count (its IndexEntryData; the text of
// the format has them not). Its older readers stop at 6, which is read and not written.
constexpr DeepType kDeepTypes[] = {{3, 10}, {4, 12}, {5, 14}, {6, 11}};
constexpr std::uint32_t kLastWritten = 5, kLastRead = 6;

/// The number in the index of what has so many bits.
std::uint32_t number_of(int pixel_type, int bits) {
  for (const DeepType& deep : kDeepTypes)
    if (pixel_type == 1 && bits == deep.bits && deep.number <= kLastWritten) return deep.number;
  return static_cast<std::uint32_t>(pixel_type);
}

/// And back.
void set_type(NdtiffEntry& entry, std::uint32_t number) {
  entry.pixel_type = static_cast<int>(number);
  entry.bits = 0;
  for (const DeepType& deep : kDeepTypes) {
    if (number != deep.number) continue;
    entry.pixel_type = 1;
    entry.bits = deep.bits;
  }
}

/// Offsets within one page. The small values (bits of RGB, two resolutions) stand between directory
/// and pixels.
struct Page {
  Page(std::uint64_t start, int pixel_type, std::uint64_t pixel_bytes)
      : at(start),
        small_at(at + 2 + kEntries * 12 + kLinkBytes),
        pixels_at(small_at + (pixel_type == 2 ? 6 : 0) + 16),
        metadata_at(pixels_at + pixel_bytes) {}
  std::uint64_t link_at() const { return small_at - kLinkBytes; }
  std::uint64_t at;
  std::uint64_t small_at;
  std::uint64_t pixels_at;
  std::uint64_t metadata_at;
};

// The way back from an entry to its page's link, by the layout of Page: link, bits of RGB, two
// resolutions of 8 bytes, pixels.
std::uint64_t link_of(const NdtiffEntry& entry) {
  return entry.pixels_at - 16 - (entry.pixel_type == 2 ? 6 : 0) - kLinkBytes;
}

// TIFF 6.0, section 2. Tags: 256 width, 257 height, 258 bits, 259 compression, 262 photometric
// interpretation, 273 and 279 offset and size of the one strip, 277 samples a pixel, 278 rows a
// strip, 282 and 283 resolutions, 296 resolution unit, 51123 Micro-Manager's metadata; in ascending
// order.
std::string directory_of(const Page& page, const NdtiffEntry& entry) {
  const bool rgb = entry.pixel_type == 2;
  const std::uint32_t bits = entry.pixel_type == 1 ? 16 : 8;
  constexpr std::uint32_t kText = 2;
  constexpr std::uint32_t kShort = 3;
  constexpr std::uint32_t kLong = 4;
  constexpr std::uint32_t kRational = 5;
  Bytes bytes;
  bytes.u16(kEntries);
  bytes.tag(256, kLong, 1, entry.width_px).tag(257, kLong, 1, entry.height_px);
  bytes.tag(258, kShort, rgb ? 3 : 1, rgb ? page.small_at : bits);
  bytes.tag(259, kShort, 1, 1).tag(262, kShort, 1, rgb ? 2 : 1);  // uncompressed; 0 is black
  bytes.tag(273, kLong, 1, entry.pixels_at)
      .tag(277, kShort, 1, rgb ? 3 : 1)
      .tag(278, kShort, 1, entry.height_px);
  bytes.tag(279, kLong, 1, entry.pixel_bytes());
  // Two rationals 1/1 with the unit "none" (296 = 1): baseline TIFF requires the tags, the true
  // scale stands in the summary.
  bytes.tag(282, kRational, 1, entry.pixels_at - 16).tag(283, kRational, 1, entry.pixels_at - 8);
  bytes.tag(296, kShort, 1, 1).tag(51123, kText, entry.metadata_bytes, entry.metadata_at);
  bytes.u32(0);  // the last page, until the next one is whole
  if (rgb) bytes.u16(bits).u16(bits).u16(bits);
  bytes.u32(1).u32(1).u32(1).u32(1);
  return bytes.str();
}

// An entry of the index: axes and file name as text with their lengths, then eight 32-bit numbers:
// offset of the pixels, width, height, pixel type, compression of the pixels (0: none), offset and
// length of the metadata, compression of the metadata.
std::string index_text(const NdtiffEntry& entry) {
  Bytes bytes;
  bytes.text(text_of(entry.axes)).text(entry.file).u32(entry.pixels_at);
  bytes.u32(entry.width_px)
      .u32(entry.height_px)
      .u32(number_of(entry.pixel_type, entry.bits))
      .u32(0);
  bytes.u32(entry.metadata_at).u32(entry.metadata_bytes).u32(0);
  return bytes.str();
}

}  // namespace

std::uint64_t NdtiffEntry::pixel_bytes() const {
  const std::uint64_t each = pixel_type == 2 ? 3 : pixel_type == 1 ? 2 : 1;
  return each * static_cast<std::uint64_t>(width_px) * static_cast<std::uint64_t>(height_px);
}

NdtiffWriter::NdtiffWriter(const std::filesystem::path& folder, const std::string& name,
                           const nlohmann::json& summary, std::uint64_t largest_file)
    : folder_(folder), name_(name), summary_(text_of(summary)), largest_(largest_file) {
  // The index is made with O_EXCL: a stack of an earlier run in this folder is an error, never
  // continued.
  std::filesystem::create_directories(folder);
  index_ = create_new_file(folder / "NDTiff.index");
  try {
    begin_file();
  } catch (const std::exception&) {
    close_file(index_);
    throw;
  }
}

NdtiffWriter::~NdtiffWriter() {
  close_file(stack_);
  close_file(index_);
}

// The head: byte order "II", 42, offset of the first page (0 until there is one), NDTiff's marks
// and the summary.
// Files are NAME_NDTiffStack.tif, NAME_NDTiffStack_1.tif and so on. The new one is made, with
// its head, before the old one is closed: where the disk refuses it, the writer is as it was.
void NdtiffWriter::begin_file() {
  const std::string next =
      name_ + kStackName + (files_ == 0 ? "" : "_" + std::to_string(files_)) + ".tif";
  Bytes head;
  head.u16(0x4949).u16(42).u32(0).u32(kMagic).u32(kMajor).u32(kMinor).u32(kSummary).text(summary_);
  // TIFF wants directories on even offsets; the space is outside of the summary's stated length.
  if (head.str().size() % 2 == 1) head.str() += ' ';
  int made = create_new_file(folder_ / next);
  try {
    write_at(made, 0, head.str(), folder_ / next);
  } catch (const std::exception&) {
    close_file(made);
    std::error_code ignored;
    std::filesystem::remove(folder_ / next, ignored);
    throw;
  }
  close_file(stack_);
  stack_ = made;
  file_ = next;
  ++files_;
  end_ = head.str().size();
  link_at_ = kHeadLink;
}

// `end_` and `link_at_` move only when all is written: after an error the next page takes the same
// place, and what was half written is overwritten.
NdtiffEntry NdtiffWriter::write(const nlohmann::json& axes, const cv::Mat& image,
                                const nlohmann::json& metadata, int bits) {
  NdtiffEntry entry;
  entry.axes = axes;
  set_type(entry, number_of(pixel_type_of(image), bits));
  entry.width_px = image.cols;
  entry.height_px = image.rows;
  cv::Mat pixels;  // never converted in place: the image belongs to the caller
  if (entry.pixel_type == 2)
    cv::cvtColor(image, pixels, cv::COLOR_BGR2RGB);
  else
    pixels = image;
  if (!pixels.isContinuous()) pixels = pixels.clone();
  std::string words = text_of(metadata);
  if ((entry.pixel_bytes() + words.size()) % 2 == 1) words += ' ';  // pages begin on even offsets
  constexpr std::uint64_t kRoom = 4096;  // bytes for the directory, more than it has
  // Never a new file behind an empty one (link_at_ is still in the head): a frame that fits into no
  // file would make files without end.
  if (end_ + entry.pixel_bytes() + words.size() + kRoom > largest_ && link_at_ != kHeadLink)
    begin_file();
  const Page page(end_, entry.pixel_type, entry.pixel_bytes());
  entry.file = file_;
  entry.pixels_at = page.pixels_at;
  entry.metadata_at = page.metadata_at;
  entry.metadata_bytes = words.size();
  const std::string directory = directory_of(page, entry);
  const std::filesystem::path stack = folder_ / file_;
  const std::filesystem::path index = folder_ / "NDTiff.index";
  try {
    write_at(stack_, page.at, directory, stack);
    write_at(stack_, page.pixels_at,
             {reinterpret_cast<const char*>(pixels.data), entry.pixel_bytes()}, stack);
    write_at(stack_, page.metadata_at, words, stack);
  } catch (const std::exception&) {
    shorten_file(stack_, end_);
    throw;
  }
  // The page is whole in the file before anything refers to it: first the chain of pages, then the
  // index. After a kill in between the page is in TIFF's chain and not in the index: mend_ndtiff().
  write_at(stack_, link_at_, Bytes().u32(page.at).str(), stack);
  append_whole(index_, index_text(entry), index);
  link_at_ = page.link_at();
  end_ = page.metadata_at + words.size();
  return entry;
}

// The stack first: the system may have written either file on its own before, but this call never
// makes an entry durable whose pixels are not.
void NdtiffWriter::sync() {
  sync_file(stack_, folder_ / file_);
  sync_file(index_, folder_ / "NDTiff.index");
}

namespace {

/// One entry of an index, or nothing where the text ends within it.
class IndexReader {
 public:
  IndexReader(const std::string& text, const std::filesystem::path& file)
      : text_(text), file_(file) {}
  // False where the text ends within an entry, as it does after a kill; what is whole but makes no
  // sense throws, since no interruption of this writer can have made it.
  bool next(NdtiffEntry& entry) {
    std::size_t at = whole_;
    std::string axes;
    std::array<std::uint32_t, 8> numbers{};
    if (!read_text(at, axes) || axes.empty() || !read_text(at, entry.file)) return false;
    if (at + sizeof numbers > text_.size()) return false;
    std::memcpy(numbers.data(), text_.data() + at, sizeof numbers);
    entry.axes = nlohmann::json::parse(axes, nullptr, false);
    const bool named =
        !entry.file.empty() && entry.file.find_first_of(std::string("/\0", 2)) == std::string::npos;
    // Sides are compared less one: unsigned, so that 0 becomes the largest number and is refused
    // too.
    constexpr std::uint32_t kLargest = 1u << 16;  // px
    if (!entry.axes.is_object() || !named || numbers[1] - 1 >= kLargest ||
        numbers[2] - 1 >= kLargest || numbers[3] > kLastRead || numbers[4] != 0 || numbers[7] != 0)
      throw std::runtime_error(file_.string() + ": is not an NDTiff index that this program reads");
    entry.pixels_at = numbers[0];
    entry.width_px = static_cast<int>(numbers[1]);
    entry.height_px = static_cast<int>(numbers[2]);
    set_type(entry, numbers[3]);
    entry.metadata_at = numbers[5];
    entry.metadata_bytes = numbers[6];
    whole_ = at + sizeof numbers;
    entry.index_end = whole_;
    if (entry.pixels_at < kSmallestHead ||
        entry.metadata_at < entry.pixels_at + entry.pixel_bytes())
      throw std::runtime_error(file_.string() + ": has an entry whose page cannot be");
    return true;
  }
  std::size_t whole() const { return whole_; }

 private:
  // The order of the comparison matters: `size` comes from the file, and at + size could wrap
  // around.
  bool read_text(std::size_t& at, std::string& into) const {
    std::uint32_t size = 0;
    if (at + sizeof size > text_.size()) return false;
    std::memcpy(&size, text_.data() + at, sizeof size);
    if (size > text_.size() - at - sizeof size) return false;
    into = text_.substr(at + sizeof size, size);
    at += sizeof size + size;
    return true;
  }
  const std::string& text_;
  const std::filesystem::path& file_;
  std::size_t whole_ = 0;
};

}  // namespace

std::vector<NdtiffEntry> read_ndtiff_index(const std::filesystem::path& folder,
                                           std::uint64_t* whole_bytes) {
  const std::filesystem::path file = folder / "NDTiff.index";
  const std::string text = read_whole_file(file);
  IndexReader reader(text, file);
  std::vector<NdtiffEntry> entries;
  NdtiffEntry entry;
  while (reader.next(entry)) entries.push_back(entry);
  if (whole_bytes) *whole_bytes = reader.whole();
  return entries;
}

// No lock is needed while the stack grows: an entry that is in the index has its page whole in
// front of it.
cv::Mat read_ndtiff_image(const std::filesystem::path& folder, const NdtiffEntry& entry) {
  constexpr int kTypes[] = {CV_8UC1, CV_16UC1, CV_8UC3};
  const std::filesystem::path file = folder / entry.file;
  // Before memory is asked for what a broken index may claim.
  if (file_size_or_zero(file) < entry.pixels_at + entry.pixel_bytes())
    throw std::runtime_error(file.string() + ": ends before its pixels do");
  cv::Mat image(entry.height_px, entry.width_px, kTypes[entry.pixel_type]);
  read_at(file, entry.pixels_at, image.data, entry.pixel_bytes());
  if (entry.pixel_type == 2) cv::cvtColor(image, image, cv::COLOR_RGB2BGR);
  return image;
}

nlohmann::json read_ndtiff_metadata(const std::filesystem::path& folder, const NdtiffEntry& entry) {
  const std::filesystem::path file = folder / entry.file;
  if (file_size_or_zero(file) < entry.metadata_at + entry.metadata_bytes)
    throw std::runtime_error(file.string() + ": ends before its metadata do");
  std::string text(entry.metadata_bytes, '\0');
  read_at(file, entry.metadata_at, text.data(), text.size());
  nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  return json.is_object() ? json : nlohmann::json::object();
}

namespace {

/// Where a file without pages ends: behind the summary, on an even offset. 0 where half the head is
/// missing.
std::uint64_t head_end(const std::filesystem::path& stack) {
  const std::uint64_t size = file_size_or_zero(stack);
  std::uint32_t summary = 0;
  if (size < kHeadBytes) return 0;
  read_at(stack, kHeadBytes - sizeof summary, &summary, sizeof summary);
  const std::uint64_t end = kHeadBytes + summary + summary % 2;
  return end <= size ? end : 0;
}

/// Cuts a file of a stack behind the last of its pages that an entry names; TIFF's chain ends there
/// too, by a link of 0.
void cut_stack(const std::filesystem::path& stack, const std::vector<NdtiffEntry>& entries) {
  const auto last = std::find_if(entries.rbegin(), entries.rend(), [&](const NdtiffEntry& entry) {
    return entry.file == stack.filename();
  });
  const bool named = last != entries.rend();
  const std::uint64_t end = named ? last->metadata_at + last->metadata_bytes : head_end(stack);
  if (end > file_size_or_zero(stack)) return;  // a page is missing: there is nothing to cut
  std::filesystem::resize_file(stack, end);
  if (end == 0) return;
  const Descriptor file(open_existing_file(stack));
  write_at(file.number(), named ? link_of(*last) : kHeadLink, std::string(4, '\0'), stack);
}

}  // namespace

// Keeps the longest run of entries from the beginning whose pages are all there. Every file is cut:
// a page may have come without its entry into the last one of the index, or into one behind it.
std::vector<NdtiffEntry> mend_ndtiff(const std::filesystem::path& folder) {
  std::uint64_t whole = 0;
  std::vector<NdtiffEntry> entries = read_ndtiff_index(folder, &whole);
  while (!entries.empty()) {
    // The metadata stand last in a page: where they are there, the page is.
    const NdtiffEntry& last = entries.back();
    if (last.metadata_at + last.metadata_bytes <= file_size_or_zero(folder / last.file)) break;
    entries.pop_back();
    whole = entries.empty() ? 0 : entries.back().index_end;
  }
  std::filesystem::resize_file(folder / "NDTiff.index", whole);
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    const std::string name = file.path().filename().string();
    if (name.ends_with(".tif") && name.find(kStackName) != std::string::npos)
      cut_stack(file.path(), entries);
  }
  return entries;
}

}  // namespace vitreo
