// Focus measures: sharpness of an image in a window, by the field's usual measures behind one
// interface, and a window that follows an object.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <string_view>
#include <vector>

namespace vitreo::vision {

/// All are means over the window's pixels, so windows of different size compare. mu: mean gray
/// level, s^2: variance. Names as in the comparisons of Sun, Duthaler & Nelson (2004) and Pertuz,
/// Puig & Garcia (2013).
enum class FocusMeasure {
  normalized_variance,  ///< s^2/mu, the thesis' (section 4.4.1, Sun 2004): follows the lamp's
                        ///< flicker
  variance_over_mean_squared,  ///< s^2/mu^2: independent of the lamp
  tenengrad,                   ///< Gx^2 + Gy^2 of Sobel's gradient (Tenenbaum 1970, Krotkov 1987)
  smoothed_tenengrad,  ///< the same on an image smoothed with sigma 1 px, over mu^2: the default
  brenner,             ///< (I(u+2) - I(u))^2 (Brenner et al. 1976)
  /// Variance of the 4-neighbor Laplacian (Pech-Pacheco et al. 2000); poor in little light.
  laplacian_variance,
  /// |2I - I(u-1) - I(u+1)| + |2I - I(v-1) - I(v+1)| (Nayar & Nakagawa 1994); poor in little light.
  modified_laplacian,
  vollath4,  ///< I(u) I(u+1) - I(u) I(u+2) (Vollath 1987, F4)
};
constexpr FocusMeasure kDefaultFocusMeasure = FocusMeasure::smoothed_tenengrad;

const std::vector<FocusMeasure>& focus_measures();
std::string_view name_of(FocusMeasure measure);
/// By name, as written above. Throws std::invalid_argument that lists the names.
FocusMeasure focus_measure(std::string_view name);

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
