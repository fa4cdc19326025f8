// SPDX-License-Identifier: Apache-2.0
#include "vision/focus.h"

#include "vision/focus_terms.h"
#include "vision/preconditions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace vitreo::vision {
namespace {

constexpr int kSmallestWindow = 4;  // px a side: in fewer pixels the mean of a measure is chance
constexpr int kLargestReach = 3;    // of all rules

// The image without the border that the neighborhood of a pixel needs.
// May be empty or negative for a small image; intersection() then is empty.
cv::Rect interior(const cv::Mat& image, int reach) {
  return {reach, reach, image.cols - 2 * reach, image.rows - 2 * reach};
}

// Intersection in 64 bits: OpenCV's & of rectangles overflows for extreme ones. Empty is {}.
cv::Rect intersection(const cv::Rect& area, const cv::Rect& to) {
  const auto end = [](int start, int length) { return static_cast<std::int64_t>(start) + length; };
  const int left = std::max(area.x, to.x);
  const int top = std::max(area.y, to.y);
  const auto right = std::min(end(area.x, area.width), end(to.x, to.width));
  const auto bottom = std::min(end(area.y, area.height), end(to.y, to.height));
  if (right <= left || bottom <= top) return {};
  return {left, top, static_cast<int>(right - left), static_cast<int>(bottom - top)};
}

cv::Rect widened(const cv::Rect& area, int by) {
  return {area.x - by, area.y - by, area.width + 2 * by, area.height + 2 * by};
}

void check_gray(const cv::Mat& image) {
  require(!image.empty() && image.dims == 2 && image.type() == CV_8UC1,
          "image: a focus measure wants an 8-bit gray image that is not empty");
}

}  // namespace

// Throws std::invalid_argument naming size or margin. The margin is what the window may move
// without a new pass over the image.
FocusWindow::FocusWindow(FocusMeasure measure, const cv::Size& size_px, int margin_px)
    : measure_(measure), size_(size_px), margin_(margin_px) {
  rule_of(measure);                 // throws for a number that is no measure
  constexpr int kMostPx = 1 << 15;  // no camera's image is larger
  require(std::min(size_px.width, size_px.height) >= kSmallestWindow &&
              std::max(size_px.width, size_px.height) <= kMostPx,
          "size_px: a focus window has 4 to 32768 pixels a side");
  require(margin_px >= 0 && margin_px <= kMostPx, "margin_px: must be 0 to 32768");
}

// The window's part with all its neighborhoods in the image.
// Throws std::invalid_argument when less than 4 x 4 px are left. Depends on the image's size, not
// on what was measured.
cv::Rect FocusWindow::clipped(const cv::Point& center_px) const {
  // Far outside is outside: clamped first, so that the sums below cannot overflow.
  const int u = std::clamp(center_px.x, -size_.width, image_.cols + size_.width);
  const int v = std::clamp(center_px.y, -size_.height, image_.rows + size_.height);
  const cv::Rect whole(u - size_.width / 2, v - size_.height / 2, size_.width, size_.height);
  const cv::Rect area = intersection(whole, interior(image_, rule_of(measure_).reach));
  require(area.width >= kSmallestWindow && area.height >= kSmallestWindow,
          "center_px: fewer than 4 x 4 pixels of the focus window lie in the image");
  return area;
}

// Measures the window with its margin once, so that move() within the margin only reads the table.
// The image is kept (its pixels are shared, not copied) for moves beyond the margin. Saturated
// pixels are counted because a measure of a clipped image is no measure of focus.
FocusReading FocusWindow::look(const cv::Mat& image, const cv::Point& center_px) {
  check_gray(image);
  window_ = {};  // move() must not use the old table, should this throw
  image_ = image;
  const cv::Rect area = clipped(center_px);
  measure_area(intersection(widened(area, margin_), interior(image_, rule_of(measure_).reach)));
  window_ = area;
  std::int64_t full = 0;
  for (int v = area.y; v < area.y + area.height; ++v) {
    const unsigned char* const row = image_.ptr(v) + area.x;
    for (int i = 0; i < area.width; ++i) full += row[i] == 255;
  }
  saturated_ = static_cast<double>(full) / area.area();
  return reading();
}

// Throws std::logic_error before the first look(). Within the margin it costs the same however far
// the window moved.
FocusReading FocusWindow::move(const cv::Point& center_px) {
  if (window_.empty())
    throw std::logic_error("a focus window must look at an image before it can move");
  const cv::Rect area = clipped(center_px);
  if (intersection(area, known_) != area) return look(cv::Mat(image_), center_px);
  window_ = area;
  return reading();
}

// The integral images (summed-area tables, Crow 1984) of gray level, term and response over `area`:
// T(i, j) = sum of all pixels above row j and left of column i.
// 64-bit sums: a 32-bit one would overflow on squares of a large window.
void FocusWindow::measure_area(const cv::Rect& area) {
  known_ = area;
  const FocusRule& rule = rule_of(measure_);
  const auto width = static_cast<std::size_t>(area.width);
  const auto height = static_cast<std::size_t>(area.height);
  term_.resize(width);
  response_.assign(width, 0);
  table_.resize((width + 1) * (height + 1));
  std::fill_n(table_.begin(), width + 1, Sums{});
  std::array<const unsigned char*, 2 * kLargestReach + 1> rows{};
  const unsigned char** const middle = rows.data() + kLargestReach;
  for (int j = 0; j < area.height; ++j) {
    // The rows about this one, addressed from -reach to reach.
    for (int k = -rule.reach; k <= rule.reach; ++k) middle[k] = image_.ptr(area.y + j + k);
    rule.terms({middle, area.x, area.x + area.width, term_.data(), response_.data(), &scratch_});
    const unsigned char* const gray = image_.ptr(area.y + j) + area.x;
    const Sums* above = table_.data() + static_cast<std::size_t>(j) * (width + 1);
    Sums* cell = table_.data() + (static_cast<std::size_t>(j) + 1) * (width + 1);
    Sums row;
    *cell = row;
    for (std::size_t i = 0; i < width; ++i) {
      row.gray += gray[i], row.term += term_[i], row.response += response_[i];
      ++above, ++cell;
      *cell = {above->gray + row.gray, above->term + row.term, above->response + row.response};
    }
  }
}

// Sum over the window from four corners of the table, T(r, b) - T(l, b) - T(r, t) + T(l, t): the
// same cost whatever the window's size and motion.
FocusWindow::Sums FocusWindow::sums() const {
  const auto left = static_cast<std::size_t>(window_.x - known_.x);
  const auto top = static_cast<std::size_t>(window_.y - known_.y);
  const std::size_t right = left + static_cast<std::size_t>(window_.width);
  const std::size_t stride = static_cast<std::size_t>(known_.width) + 1;
  const Sums* const above = table_.data() + top * stride;
  const Sums* const below = above + static_cast<std::size_t>(window_.height) * stride;
  const auto of = [&](std::int64_t Sums::*part) {
    return below[right].*part - below[left].*part - above[right].*part + above[left].*part;
  };
  return {of(&Sums::gray), of(&Sums::term), of(&Sums::response)};
}

// The measure from the means of its terms over the window (FocusRule::value).
// Saturation is that of the last look(), as only that counted.
FocusReading FocusWindow::reading() const {
  FocusReading reading;
  reading.pixels = window_.area();
  const double n = reading.pixels;
  const Sums total = sums();
  reading.mean = static_cast<double>(total.gray) / n;
  reading.value = rule_of(measure_).value(reading.mean, static_cast<double>(total.term) / n,
                                          static_cast<double>(total.response) / n);
  reading.saturated = saturated_;
  return reading;
}

// For one image: a window without a margin.
FocusReading focus(const cv::Mat& image, const cv::Rect& where, FocusMeasure measure) {
  check_gray(image);
  const cv::Rect area = intersection(where, {0, 0, image.cols, image.rows});
  require(area.width >= kSmallestWindow && area.height >= kSmallestWindow,
          "where: fewer than 4 x 4 pixels of it lie in the image");
  FocusWindow window(measure, area.size(), 0);
  return window.look(image, {area.x + area.width / 2, area.y + area.height / 2});
}

}  // namespace vitreo::vision
