// Contour measurement: the robot's elliptic rim in a gray image, to a fraction of a pixel.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/edge_model.h"
#include "vision/ellipse.h"
#include "vision/ellipse_fit.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <optional>
#include <vector>

namespace vitreo::vision {

struct ContourSettings {
  int normals = 64;
  double search_px = 8;
  double blur_sigma_px = 2;
  double min_contrast = 8;
  bool corners = false;  // the rim is no ellipse: flat ends
};

/// Coarse: where each normal crosses half the contrast to the ground, which finds the rim from some
/// pixels away. Fine: at each normal the rim's shift by least squares of the image against what a
/// body in front of that ground would look like (EdgeModel), which a shaded body, a curved rim and
/// a patterned ground do not bias. The blur is one more unknown, common to all normals: it starts
/// at `blur_sigma_px`, or, where the half crossings are clearly less steep, at the blur they imply,
/// and may come out between 0.4 times `blur_sigma_px` and 2.5 times that or 6 px, whichever is
/// more.
class Contour {
 public:
  explicit Contour(const ContourSettings& settings);
  /// With `corners` by the half crossings alone, to a tenth of a pixel: an edge model at an ellipse
  /// that the rim leaves by pixels fits nothing.
  /// `image` CV_8U, `ground` CV_32F of the same size, `noise` of a gray level (CV_32F 1x256).
  /// `start` within some settings.search_px of the rim. Nothing when too little of a rim is there.
  std::optional<EllipseMeasurement> measure(const cv::Mat& image, const cv::Mat& ground,
                                            const cv::Mat& noise, const Ellipse& start);

 private:
  struct Images {
    const cv::Mat& image;
    const cv::Mat& ground;
    const cv::Mat& noise;
  };
  struct Samples {  // along one normal, from inside outwards, 1 px apart
    std::array<double, EdgeModel::kMaxSamples> image;
    std::array<double, EdgeModel::kMaxSamples> ground;
  };
  struct Edge {                // one normal's result of a round, with the blur's reduced equation
    double trust = 0;          // weight of the normal in the round before
    double misfit = 0;         // residual variance, gray levels^2
    double gradient = 0;       // of the blur, with shift and brightness eliminated
    double hessian = 0;        // the same, second derivative
    double shift_by_blur = 0;  // change of the solved shift per px of blur
  };
  using StepSums = Eigen::Matrix<double, 6, 6>;
  std::optional<EllipseMeasurement> cornered(const Images& images, Ellipse ellipse);
  EllipseMeasurement measurement(const FittedEllipse& fitted) const;
  bool coarse_rounds(const Images& images, Ellipse& ellipse);
  bool coarse_round(const Images& images, Ellipse& ellipse);
  struct Reach {  // px, along a normal
    int inward, outward;
  };
  Reach reach_of(std::size_t k, const Ellipse& ellipse) const;
  void half_crossing(const Images& images, const Reach& reach, Normal& normal, double& slope) const;
  void take_crossings(const Images& images, const Ellipse& ellipse);
  double allowed_blur(double sigma) const;
  std::optional<FittedEllipse> fine_round(const Images& images, const Ellipse& ellipse);
  void sample_profiles(const Images& images, const Ellipse& ellipse);
  double ground_offset() const;
  double ground_at_rim(std::size_t k) const {
    return samples_[k].ground[static_cast<std::size_t>(inside_)];
  }
  double light(std::size_t k, std::size_t j, double cover) const;
  Eigen::Matrix4d brightness_sums(std::size_t k) const;
  Eigen::Vector3d brightness(std::size_t k, double noise, Eigen::Vector3d& prior) const;
  StepSums step_sums(std::size_t k, const Eigen::Vector3d& body) const;
  void fit_edge(const Images& images, std::size_t k);
  void drop_misfits();
  void improve_blur();
  const EdgeModel::Profile& profile(std::size_t k) const;
  double median_contrast() const;

  ContourSettings settings_;
  EdgeModel model_;
  double sigma_ = 2;   // blur, px
  double inside_ = 0;  // depth of the first sample within the rim, px
  double offset_ = 0;  // of the ground from the learnt one, gray levels
  int count_ = 0;      // samples per normal
  // Of a quarter of the normals: the others are their mirror images.
  std::vector<EdgeModel::Profile> profiles_;
  std::vector<Normal> normals_;
  std::vector<Samples> samples_;
  std::vector<Edge> edges_;
};

}  // namespace vitreo::vision
