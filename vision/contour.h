// The robot's rim in an image, to a fraction of a pixel.
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
  double search_px = 8, blur_sigma_px = 2, min_contrast = 8;
};

/// First where each normal crosses half the contrast to the ground, which finds the rim from some
/// pixels away; then, at each normal, the rim's place by least squares of what a body in front of
/// that ground would look like (EdgeModel), which a shaded body, a bent rim and a patterned ground
/// do not shift. The blur is one more unknown, common to all normals: it starts at `blur_sigma_px`,
/// or, where the half crossings are clearly less steep, at what they tell, and may come out between
/// 0.4 times `blur_sigma_px` and 2.5 times that or 6 px, whichever is more.
class Contour {
 public:
  explicit Contour(const ContourSettings& settings);
  /// `image` CV_8U, `ground` CV_32F of the same size, `noise` of a gray level (CV_32F 1x256).
  /// `start` within some settings.search_px of the rim. Nothing when too little of a rim is there.
  std::optional<EllipseMeasurement> measure(const cv::Mat& image, const cv::Mat& ground,
                                            const cv::Mat& noise, const Ellipse& start);

 private:
  struct Images {
    const cv::Mat &image, &ground, &noise;
  };
  struct Samples {  // along one normal, from inside outwards, 1 px apart
    std::array<double, EdgeModel::kMaxSamples> image, ground;
  };
  struct Edge {  // what one normal says in a round: of itself, and of the blur
    double trust = 0, misfit = 0, pull = 0, stiffness = 0, shift_by_blur = 0;
  };
  using StepSums = Eigen::Matrix<double, 6, 6>;
  bool coarse_rounds(const Images& images, Ellipse& ellipse);
  bool coarse_round(const Images& images, Ellipse& ellipse);
  void half_crossing(const Images& images, Normal& normal, double& slope) const;
  double allowed_blur(double sigma) const;
  std::optional<FittedEllipse> fine_round(const Images& images, const Ellipse& ellipse);
  void look(const Images& images, const Ellipse& ellipse);
  double ground_offset() const;
  double ground_at_rim(std::size_t k) const {
    return samples_[k].ground[static_cast<std::size_t>(inside_)];
  }
  double light(std::size_t k, std::size_t j, double cover) const;
  Eigen::Matrix4d brightness_sums(std::size_t k) const;
  Eigen::Vector3d brightness(std::size_t k, double noise, Eigen::Vector3d& prior) const;
  StepSums step_sums(std::size_t k, const Eigen::Vector3d& body) const;
  void place_edge(const Images& images, std::size_t k);
  void drop_misfits();
  void improve_blur();
  const EdgeModel::Profile& profile(std::size_t k) const;
  double median_contrast() const;

  ContourSettings settings_;
  EdgeModel model_;
  double sigma_ = 2, inside_ = 0;  // px
  double offset_ = 0;              // gray levels
  int count_ = 0;
  std::vector<EdgeModel::Profile>
      profiles_;  // of a quarter of the normals: the others are their mirror images
  std::vector<Normal> normals_;
  std::vector<Samples> samples_;
  std::vector<Edge> edges_;
};

}  // namespace vitreo::vision
