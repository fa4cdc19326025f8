// Multi-start search for the poses that explain a measurement, and whether there is one, several or
// none.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/body_pose.h"
#include "optics/pose/pose_solver.h"
#include "optics/projection/projection_model.h"

#include <Eigen/Core>

#include <functional>
#include <limits>
#include <optional>

namespace vitreo::optics::detail {

/// Rotations of the body that leave it unchanged.
enum class Symmetry { none, half_turns, about_z };

/// A measurement of any kind: an ellipse, or points.
struct Measurement {
  // shown less observed, and where given a place for it and it is known, rows x 7, the derivative
  BodyResiduals difference_px;
  std::function<std::optional<double>(const BodyState&)> size_px;  // shown
  Eigen::MatrixXd root;     // times the difference: independent terms of unit variance
  Eigen::VectorXd weights;  // where given, in place of the root: one for each difference
  // of terms, beyond which they count less (pseudo-Huber): a point beside the outline is no outlier
  // of a Gaussian
  double tail = std::numeric_limits<double>::infinity();
  Eigen::Vector2d center_px{0, 0};  // observed
  double size = 0;                  // px; observed; 0: none
  Symmetry symmetry = Symmetry::none;
  // normal of a plane in the body's frame by which it is (about) its own mirror image
  Eigen::Vector3d mirror{0, 0, 1};
};

ObjectPose search_pose(const ObjectPoseSettings& settings, const Measurement& measured,
                       const PoseStart& start);

}  // namespace vitreo::optics::detail
