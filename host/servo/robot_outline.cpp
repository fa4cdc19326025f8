// SPDX-License-Identifier: Apache-2.0
#include "host/servo/robot_outline.h"

#include "control/crossed_plates.h"

#include <Eigen/Eigenvalues>

#include <cmath>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

/// px, at one point of a contour: what its own variance does not hold, as of a shade.
constexpr double kPointError_px = 0.05;

/// Points that are too few to tell a body's outline from an ellipse.
constexpr std::size_t kFewest = 24;

/// px, of a semi-axis: two of its harmonics, cos and cos 2, take what N points say.
double axis_noise(const std::vector<optics::OutlinePoint>& outline) {
  double information = 0;
  for (const auto& point : outline) information += 1 / (point.sigma_px * point.sigma_px);
  return std::sqrt(2 / information);
}

/// The nearest one that is a covariance: of a valley that is flatter than its curvature C is larger
/// than the information makes it, and its noise part may come out below nothing.
Eigen::Matrix3d positive(const Eigen::Matrix3d& symmetric) {
  constexpr double kLeast = 1e-14;  // m^2: 0.1 um
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> parts(symmetric);
  return parts.eigenvectors() * parts.eigenvalues().cwiseMax(kLeast).asDiagonal() *
         parts.eigenvectors().transpose();
}

}  // namespace

bool has_flat_ends(const control::Robot& robot) {
  return !robot.helix &&
         (robot.shape == control::BodyShape::cylinder || robot.shape == control::BodyShape::disc);
}

std::optional<optics::ObjectModel> outlined_body(const control::Robot& robot) {
  if (robot.helix) return std::nullopt;
  switch (robot.shape) {
    case control::BodyShape::crossed_plates: {
      // Of two thin ellipsoids, as the localizer has them elsewhere (crossed_ellipsoids).
      const double thickness = control::plate_thickness(robot);
      if (!(thickness > 0)) return std::nullopt;
      return optics::crossed_plates(robot.semi_axis, robot.semi_radius, thickness, true);
    }
    case control::BodyShape::cylinder:
    case control::BodyShape::disc:
      return optics::cylinder(robot.semi_axis, robot.semi_radius);
    case control::BodyShape::ellipsoid:
    case control::BodyShape::sphere:
      break;
  }
  return std::nullopt;
}

OutlineLocalizer::OutlineLocalizer(optics::ObjectPoseSettings settings, double attitude_sigma,
                                   double outline_error_px)
    : settings_(std::move(settings)), outline_error_px_(outline_error_px) {
  settings_.orientation_sigma = attitude_sigma;
}

/// The points' sigmas are made as large as the outline's systematic error is, as if that were their
/// noise, so that attitude and outline weigh against each other by what is truly not known of them.
/// With f the factor, C the covariance so found and P the prior's information, what the noise alone
/// makes of the pose is C (C^-1 - P) C / f^2; the rest of C stays from frame to frame.
std::optional<OutlinePose> OutlineLocalizer::locate(const vision::EllipseMeasurement& seen,
                                                    const Eigen::Vector3d& start_in_eye,
                                                    const Eigen::Matrix3d& expected) const {
  if (seen.contour.size() < kFewest) return std::nullopt;
  std::vector<optics::OutlinePoint> outline;
  outline.reserve(seen.contour.size());
  for (const vision::ContourPoint& point : seen.contour)
    outline.push_back(
        {point.point_px, std::sqrt(point.variance + kPointError_px * kPointError_px)});
  const double noise = axis_noise(outline);
  const double factor = std::hypot(noise, outline_error_px_) / noise;
  for (auto& point : outline) point.sigma_px *= factor;
  const auto found = optics::locate_outline(settings_, outline, {start_in_eye, expected});
  if (found.status != optics::PoseStatus::found && found.status != optics::PoseStatus::ambiguous)
    return std::nullopt;
  const optics::PoseCandidate& best = found.candidates.front();  // the smallest chi^2
  const Eigen::Matrix<double, 6, 6> C = best.covariance.topLeftCorner<6, 6>();
  if (!C.allFinite()) return std::nullopt;
  const double prior = 1 / (settings_.orientation_sigma * settings_.orientation_sigma);
  Eigen::Matrix<double, 6, 6> P = Eigen::Matrix<double, 6, 6>::Zero();
  P.diagonal().tail<3>().setConstant(prior);
  const Eigen::Matrix3d of_noise = (C - C * P * C).topLeftCorner<3, 3>() / (factor * factor);
  OutlinePose pose;
  pose.position_in_eye = best.pose.position_in_eye;
  pose.attitude = best.pose.orientation;
  pose.noise = positive(of_noise);
  pose.stays = C.topLeftCorner<3, 3>() - pose.noise;
  Eigen::Matrix<double, 3, 2> across;  // what turning about the body's first two axes does to it
  across << -pose.attitude.col(1), pose.attitude.col(0);
  pose.axis_covariance = across * C.block<2, 2>(3, 3) * across.transpose();
  pose.residual_px = best.residual_px;
  return pose;
}

}  // namespace vitreo
