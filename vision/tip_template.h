// Tip template: where a point of an object that was pointed at in one image lies in others.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <optional>
#include <vector>

namespace vitreo::vision {

/// One image's gray levels between the object's middle and a little beyond its tip, in the frame of
/// the body's ellipse. Unlike HeadModel, which asks for four images with tips, it makes them: by
/// the normalized cross-correlation alone, without a covariance.
class TipTemplate {
 public:
  /// `image` CV_8UC3; `body` the ellipse there, `tip_px` the point. Throws std::invalid_argument
  /// where the tip is not in the image, lies within half a semi-minor axis of the body's middle,
  /// or farther than four semi-major axes from it.
  TipTemplate(const cv::Mat& image, const Ellipse& body, const Eigen::Vector2d& tip_px);
  /// px of the image; nothing where neither heading fits (correlation below 0.6), where both fit
  /// alike (within 0.1), or where the tip is out of the image.
  std::optional<Eigen::Vector2d> find(const cv::Mat& image, const Ellipse& body) const;

 private:
  struct Fit {
    double correlation = -1;
    Eigen::Vector2d tip{0, 0};  // in the body's frame, of the template's size
  };
  cv::Mat sampled(const cv::Mat& image, const Ellipse& body, double heading, double margin) const;
  Fit best_of(const cv::Mat& image, const Ellipse& body, double heading) const;

  Eigen::Vector2d tip_{0, 0};  // px of the first image, x along the tip's half of the major axis
  double scale_px_ = 1;        // sqrt(a b) there
  double from_ = 0;            // of the template along x; it ends kBeyond_px after the tip
  int columns_ = 0;
  int rows_ = 0;
  cv::Mat template_;
};

}  // namespace vitreo::vision
