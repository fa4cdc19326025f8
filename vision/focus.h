// Focus measures: sharpness of an image in a window, by the field's usual measures behind one
// interface, and a window that follows an object.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/focus_measure.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <vector>

namespace vitreo::vision {

struct FocusReading {
  double value = 0;      ///< 0 where nothing varies: a blank, black or saturated window
  double mean = 0;       ///< gray level
  double saturated = 0;  ///< share of the pixels at 255; in a moved window that of the last look()
  int pixels = 0;        ///< that were measured
};

/// The measure over `where`, cut to what lies in the image with the measure's neighborhood. Throws
/// std::invalid_argument when the image is not 8-bit gray or when fewer than 4 x 4 pixels are left.
FocusReading focus(const cv::Mat& image, const cv::Rect& where,
                   FocusMeasure measure = kDefaultFocusMeasure);

/// A window that follows an object. `look` measures a new image, `margin_px` beyond the window,
/// into a table of sums; `move` reads another window of the same image from it, and looks anew only
/// beyond the margin. Nothing is allocated after the first look, at the same size.
class FocusWindow {
 public:
  FocusWindow(FocusMeasure measure, const cv::Size& size_px, int margin_px = 16);
  /// The image's pixels must not change until the next look. Errors as focus().
  FocusReading look(const cv::Mat& image, const cv::Point& center_px);
  /// As look() again, at the cost of four table entries. Throws std::logic_error before the first
  /// look.
  FocusReading move(const cv::Point& center_px);
  const cv::Rect& window_px() const { return window_; }  ///< what was measured last

 private:
  struct Sums {
    std::int64_t gray = 0;
    std::int64_t term = 0;
    std::int64_t response = 0;
  };
  cv::Rect clipped(const cv::Point& center_px) const;
  void measure_area(const cv::Rect& area);
  Sums sums() const;
  FocusReading reading() const;

  FocusMeasure measure_;
  cv::Size size_;
  int margin_;
  cv::Mat image_;
  cv::Rect known_;   // what the table covers
  cv::Rect window_;  // what was measured last
  std::vector<Sums>
      table_;  // integral image over known_: of all pixels above and left of each corner
  std::vector<std::int32_t> term_;
  std::vector<std::int32_t> response_;
  std::vector<std::int32_t> scratch_;
  double saturated_ = 0;
};

}  // namespace vitreo::vision
