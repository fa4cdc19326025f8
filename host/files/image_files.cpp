// SPDX-License-Identifier: Apache-2.0
#include "host/files/image_files.h"

#include "host/files/run_folder.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <fstream>
#include <stdexcept>
#include <string_view>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

// Against files that would take the memory: the first is checked before decoding.
// Deflate packs up to a thousandfold: a PNG of a megabyte may decode to a gigabyte, and so the
// second is checked as well.
constexpr std::uintmax_t kLargestFile = 256U << 20U;  // bytes
constexpr std::size_t kMostPixels = 1U << 26U;
constexpr std::string_view kMask = "_mask";

bool digit(char c) { return c >= '0' && c <= '9'; }

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

// By the stem: "eye_mask.png" and "eye_mask.tif" are masks, "eye_masked.png" is an image.
bool is_mask(const fs::path& file) { return lower(file.stem().string()).ends_with(kMask); }

/// The digits from `at` on without leading zeros; `at` moves behind them.
std::string_view number_at(const std::string& text, std::size_t& at) {
  while (at < text.size() && text[at] == '0') ++at;
  const std::size_t first = at;
  while (at < text.size() && digit(text[at])) ++at;
  return std::string_view(text).substr(first, at - first);
}

// Sorted, because the order of a folder is the file system's: a training on the same images must
// see them in the same order on every machine.
std::vector<fs::path> images_and_masks(const fs::path& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error))
    throw std::invalid_argument(folder.string() + ": there is no such folder");
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.is_regular_file() && is_image_file(entry.path())) files.push_back(entry.path());
  if (error)
    throw std::invalid_argument(folder.string() + ": cannot be listed: " + error.message());
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  return files;
}

// Decoded from memory and not by imread(), which answers every problem, a missing file or a damaged
// one, with an empty image. Every error is the operator's, thus std::invalid_argument.
cv::Mat read(const fs::path& file, int flags) {
  std::error_code error;
  const std::uintmax_t size = fs::is_regular_file(file, error) ? fs::file_size(file, error) : 0;
  if (error || !fs::is_regular_file(file, error))
    throw std::invalid_argument(file.string() + ": there is no such file");
  if (size == 0) throw std::invalid_argument(file.string() + ": is empty");
  if (size > kLargestFile) throw std::invalid_argument(file.string() + ": is larger than 256 MB");
  std::vector<char> bytes(size);
  if (!std::ifstream(file, std::ios::binary).read(bytes.data(), static_cast<std::streamsize>(size)))
    throw std::invalid_argument(file.string() + ": cannot be read");
  cv::Mat image;
  try {
    image = cv::imdecode(bytes, flags);
    // Its text names a place in OpenCV's sources, which does not help the operator.
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty())
    throw std::invalid_argument(file.string() +
                                ": is not an image that can be read, or is damaged");
  if (image.total() > kMostPixels)
    throw std::invalid_argument(file.string() + ": has more than 2^26 pixels");
  return image;
}

}  // namespace

// Numbers are compared by their count of digits, then digit by digit: no number is too long for it.
// A strict weak order, as std::sort demands, because names that differ in zeros alone are still
// told apart.
bool natural_less(const std::string& a, const std::string& b) {
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (digit(a[i]) && digit(b[j])) {
      const std::string_view x = number_at(a, i);
      const std::string_view y = number_at(b, j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
      continue;
    }
    if (a[i] != b[j]) return a[i] < b[j];
    ++i, ++j;
  }
  if (i == a.size() && j == b.size()) return a < b;  // "1" and "01": some order
  return i == a.size();
}

std::optional<long long> number_in(const fs::path& file) {
  const std::string stem = file.stem().string();
  std::size_t end = stem.size();
  while (end > 0 && !digit(stem[end - 1])) --end;
  std::size_t first = end;
  while (first > 0 && digit(stem[first - 1])) --first;
  // 10^17 fits into long long with certainty; more digits are a time stamp or a hash, no frame
  // number.
  if (first == end || end - first > 17) return std::nullopt;
  return std::stoll(stem.substr(first, end - first));
}

bool is_image_file(const fs::path& file) {
  const std::string ending = lower(file.extension().string());
  for (const char* one : {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"})
    if (ending == one) return true;
  return false;
}

std::vector<fs::path> image_files(const fs::path& folder) {
  std::vector<fs::path> files = images_and_masks(folder);
  std::erase_if(files, is_mask);
  return files;
}

cv::Mat read_color_image(const fs::path& file) { return read(file, cv::IMREAD_COLOR); }

// Read in color: a mask painted red has a gray level of 30 % of white, and its brightest channel is
// full.
cv::Mat read_mask(const fs::path& file) {
  const cv::Mat image = read(file, cv::IMREAD_COLOR);
  cv::Mat mask(image.size(), CV_8UC1);
  for (int v = 0; v < image.rows; ++v) {
    const auto* from = image.ptr<cv::Vec3b>(v);
    auto* to = mask.ptr<unsigned char>(v);
    // Half way, so that a mask that was saved as JPEG, or smoothed at its rim, keeps its size.
    for (int u = 0; u < image.cols; ++u) to[u] = std::max({from[u][0], from[u][1], from[u][2]});
  }
  double most = 0;
  cv::minMaxLoc(mask, nullptr, &most);
  cv::Mat clear;
  cv::compare(mask, most > 1 ? most / 2 : 0, clear, cv::CMP_GT);  // masks of 0 and 1 too
  return clear;
}

// A mask without its image is refused, not passed over: it is a typing error in a name, and the
// training would silently lose a pair. An image without a mask is no error: it is simply not
// labeled.
std::vector<LabeledFiles> labeled_files(const fs::path& folder) {
  const std::vector<fs::path> all = images_and_masks(folder);
  std::vector<LabeledFiles> pairs;
  for (const fs::path& mask : all) {
    if (!is_mask(mask)) continue;
    const std::string stem = mask.stem().string();
    const std::string name = stem.substr(0, stem.size() - kMask.size());
    const auto image = std::find_if(
        all.begin(), all.end(), [&](const fs::path& one) { return one.stem().string() == name; });
    if (image == all.end())
      throw std::invalid_argument(mask.string() + ": is a mask, but there is no image " + name +
                                  ".png beside it");
    pairs.push_back({name, *image, mask});
  }
  if (pairs.empty())
    throw std::invalid_argument(folder.string() +
                                ": has no training pair, an image NAME.png with NAME_mask.png");
  return pairs;
}

void write_png(const fs::path& file, const cv::Mat& image) {
  if (image.empty())
    throw std::invalid_argument(file.string() + ": there is nothing in the image to write");
  std::vector<unsigned char> bytes;
  // Encoded in memory, then written beside and renamed, where imwrite() would leave half a file on
  // a full disk.
  if (!cv::imencode(".png", image, bytes))
    throw std::runtime_error(file.string() + ": cannot be made a PNG");
  write_file(file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace vitreo
