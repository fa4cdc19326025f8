// How sharp an image is in a window: the focus measures of the field behind one interface, and a
// window that follows.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <string_view>
#include <vector>

namespace vitreo::vision {

/// All are means over the window's pixels, so windows of different size compare. mu: mean gray
/// level, s^2: variance.
enum class FocusMeasure {
  normalized_variance,  ///< s^2/mu, the thesis' (4.4.1, Sun 2004): follows the lamp's flicker
  variance_over_mean_squared,  ///< s^2/mu^2: blind to the lamp
  tenengrad,                   ///< Gx^2 + Gy^2 of Sobel's gradient
  smoothed_tenengrad,  ///< the same on an image smoothed with sigma 1 px, over mu^2: the default
  brenner,             ///< (I(u+2) - I(u))^2
  laplacian_variance,  ///< variance of the 4-neighbor Laplacian; poor in little light
  modified_laplacian,  ///< |2I - I(u-1) - I(u+1)| + |2I - I(v-1) - I(v+1)|; poor in little light
  vollath4,            ///< I(u) I(u+1) - I(u) I(u+2)
};
constexpr FocusMeasure kDefaultFocusMeasure = FocusMeasure::smoothed_tenengrad;

const std::vector<FocusMeasure>& focus_measures();
std::string_view name_of(FocusMeasure measure);
/// By name, as written above. Throws std::invalid_argument that lists the names.
FocusMeasure focus_measure(std::string_view name);

struct FocusReading {
  double value = 0;  ///< 0 where nothing varies: a blank, black or saturated window
  double mean = 0;   ///< gray level
  double saturated =
      0;           ///< share of the pixels at 255; in a moved window still that of the last look
  int pixels = 0;  ///< that were measured
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
  /// As looking again, at the cost of four corners. Throws std::logic_error before the first look.
  FocusReading move(const cv::Point& center_px);
  const cv::Rect& window_px() const { return window_; }  ///< what was measured last

 private:
  struct Sums {
    std::int64_t gray = 0, term = 0, response = 0;
  };
  cv::Rect clipped(const cv::Point& center_px) const;
  void measure_area(const cv::Rect& area);
  Sums sums() const;
  FocusReading reading() const;

  FocusMeasure measure_;
  cv::Size size_;
  int margin_;
  cv::Mat image_;
  cv::Rect known_, window_;  // what the table covers; what was measured last
  std::vector<Sums> table_;  // over known_: of all pixels above and left of each corner
  std::vector<std::int32_t> term_, response_, scratch_;
  double saturated_ = 0;
};

}  // namespace vitreo::vision
