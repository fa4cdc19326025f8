// Registration view: a flattened view as a pyramid, prepared once and registered with many.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <array>
#include <numbers>

namespace vitreo::vision {

enum class ViewModel {
  euclidean,  ///< a sensor that turns and shifts in the aerial image's plane
  affine,     ///< also scale and shear: a tilted sensor
  similarity  ///< turn, shift and scale: a focus or a zoom that changed between the views
};

struct RegistrationSettings {
  ViewModel model = ViewModel::similarity;
  double max_rotation = std::numbers::pi / 6;  ///< between two views, rad, either way
  double flatten_sigma_px = 20;                ///< structure larger than this is light, not retina
  double min_overlap = 0.1;                    ///< share of the view that must be common
  /// Of the flattened views in the overlap, at a quarter of the resolution.
  double min_correlation = 0.4;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// A view, flattened, at full, half and quarter resolution: made once, registered with many.
class RegistrationView {
 public:
  /// 8-bit gray, or BGR, of which green counts: it shows vessels best. Throws std::invalid_argument
  /// for another type, or for fewer than 64 pixels a side.
  RegistrationView(const cv::Mat& view, const RegistrationSettings& settings);
  static constexpr int kLevels = 3;
  struct Level {
    cv::Mat image;  // CV_32F, of standard deviation about 1
    cv::Mat du;     // its gradient along the rows, CV_32F
    cv::Mat dv;     // and along the columns
    cv::Mat valid;  // CV_8U, 0 where the sensor was saturated, or shows something of its own
  };
  const Level& level(int level) const { return levels_[static_cast<std::size_t>(level)]; }
  const cv::Size& size() const { return size_; }
  bool blank() const { return blank_; }  ///< no structure to register
  /// `fixed`: CV_8UC1 of the view's size, not 0 where something is fixed to the sensor. Throws
  /// std::invalid_argument for another type or size. Copies made before keep it.
  void leave_out(const cv::Mat& fixed);

 private:
  void mask_levels(const cv::Mat& out);
  cv::Size size_;
  bool blank_ = false;
  std::array<Level, kLevels> levels_;
};

}  // namespace vitreo::vision
