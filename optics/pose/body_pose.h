// Pose of a body in six degrees of freedom: settings, start, candidates and status of its
// localization.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/object_model.h"
#include "optics/pose/pose_settings.h"

#include <Eigen/Core>

#include <limits>
#include <optional>
#include <vector>

namespace vitreo::optics {

struct ObjectPoseSettings {
  SingleViewpoint projection;
  ImageScale image;
  std::optional<ExactProjection> exact{};  // when given, `projection` is not used
  ObjectModel object;                      // what shows the ellipse
  bool rotate = false;  // six degrees of freedom; else the orientation is the start's
  // rad about each body axis; of the start's, known beforehand. Not infinite: `rotate` is implied
  double orientation_sigma = std::numeric_limits<double>::infinity();
  // rad, in place of it about the body's z; infinite: not known
  std::optional<double> roll_sigma{};
  // of the body's size, relative; infinite: not known; counts as a factor e, to stay in the eye
  double scale_sigma = 0;
  // on the outline, 12 to 256; as many as the tracker's: corners make the ellipse depend on it
  int contour_points = 64;
  double max_residual_px = 8;  // above this rms the answer is `misfit`
  double behind_retina = 0;    // m, as PoseSettings have it
  // another minimum explains the measurement equally up to this much more chi^2
  double equal_chi2 = 9;
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// A position and a rotation. `orientation` takes the body's frame to the eye's.
struct BodyPose {
  Eigen::Vector3d position_in_eye{0, 0, 0};  // m
  Eigen::Matrix3d orientation = Eigen::Matrix3d::Identity();
};
/// The rotation that takes the body's z to `axis` (any length) the short way. Throws naming
/// `axis_in_eye`.
Eigen::Matrix3d orientation_along(const Eigen::Vector3d& axis_in_eye);

struct PoseCandidate {
  BodyPose pose;
  double scale = 1;  // of the size, where it is free
  /// Of position (m, 0 to 2), rotation about the body's own axes (rad, 3 to 5) and logarithm of the
  /// size (6), by J^T W J at the minimum; zero where held. Infinite, without covariances, where the
  /// measurement does not determine them.
  Eigen::Matrix<double, 7, 7> covariance = Eigen::Matrix<double, 7, 7>::Zero();
  /// Directions that are not observed, in units of 3 mm, 0.4 rad, 20 %: a sigma above one. A body's
  /// symmetry axis is one.
  std::vector<Eigen::Matrix<double, 7, 1>> unobservable;
  double chi2 = 0;  // weighted squares, of what was measured and of what was known beforehand
  // rms of the plain differences of center, axes and elongation, or of points
  double residual_px = 0;
  int iterations = 0;
};

enum class PoseStatus {
  found,
  ambiguous,      // several candidates explain the measurement equally; the best first
  misfit,         // the best one does not explain it: residual_px above the limit
  not_converged,  // the best position reached is the candidate; its covariance is infinite
  outside,        // no start could be seen through the projection: no candidate
};
const char* to_string(PoseStatus status);

struct ObjectPose {
  PoseStatus status = PoseStatus::outside;
  std::vector<PoseCandidate> candidates;
};

/// What is known before: of the last frame, or of the field. Without `rotate` the orientation is
/// needed.
struct PoseStart {
  std::optional<Eigen::Vector3d> position_in_eye{};
  std::optional<Eigen::Matrix3d> orientation{};
};

}  // namespace vitreo::optics
