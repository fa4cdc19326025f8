// Errors of localization by pose when the eye is not the assumed one (table 5.2).
// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/field_errors.h"
#include "optics/calibration/camera_calibration.h"
#include "optics/numerics/preconditions.h"
#include "optics/rays/pupil.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

const Eigen::Vector3d kAxis(1, 0, 0);  // of the robot; a sphere's does not matter

/// Step 2 of the sensitivity analysis of thesis 5.4: the isopixel lines of this eye.
/// The true and the assumed eye go through this same function, so they differ by nothing but the
/// eye.
PoseSettings looking_through(const System& system, const PoseErrorOptions& options) {
  PoseSettings settings;
  settings.robot = options.robot;
  settings.max_residual_px = 1e3;  // a wrong eye fits badly; its error is wanted all the same
  if (options.exact) {
    settings.exact = ExactProjection(system, options.microscope, options.max_m);
  } else {
    settings.projection = fit_single_viewpoint(system, options.microscope, options.max_m);
  }
  return settings;
}

/// Step 4 of thesis 5.4: the position by (5.15) with the assumed eye.
/// Starts from the size of the ellipse, without a previous position, as a localizer that has just
/// seen the robot. Nothing when it finds none; the caller counts that.
std::optional<Eigen::Vector3d> located(const PoseSettings& believed, const EllipseVector& shown) {
  const auto start = first_guess(believed, shown, kAxis);
  if (!start) return std::nullopt;
  const auto found = locate(believed, shown, EllipseCovariance::Identity(), kAxis, *start);
  return found ? std::optional(found->position_in_eye) : std::nullopt;
}

/// Steps 3 and 4 of thesis 5.4 over a grid of the field: projected with the true eye, located with
/// the assumed one.
/// A point that the true eye does not show is outside the field and does not count. One that is
/// shown but not located does; when more than a quarter of them are not, there is no answer.
std::optional<double> error_over_field(const PoseSettings& truth, const PoseSettings& believed,
                                       const System& system, const PoseErrorOptions& options) {
  constexpr double kMostMissing = 0.25;  // of the field, when there is still an answer
  int count = 0;
  int answered = 0;
  double sum = 0;
  double max = 0;
  for (int i = 0; i < options.angles; ++i) {
    for (int j = 0; j < options.depths; ++j) {
      const double depth =
          options.depth_from + (options.depth_to - options.depth_from) * j / (options.depths - 1);
      const auto point =
          point_at_field(system, options.max_angle * i / (options.angles - 1), depth);
      const auto shown = point ? project_spheroid(truth, *point, kAxis) : std::nullopt;
      if (!shown) continue;  // not in the picture
      ++count;
      const auto found = located(believed, *shown);
      if (!found) continue;
      ++answered;
      const double off = (*found - *point).norm();
      sum += off;
      max = std::max(max, off);
    }
  }
  if (answered == 0 || answered < (1 - kMostMissing) * count) return std::nullopt;
  return options.measure == ErrorMeasure::max ? max : sum / answered;
}

/// The worse of both signs of the retinal depth error.
/// The picture is that of the robot `depth_from` before the retina; calibrate_pose is told a depth
/// that is off by the error.
std::optional<double> calibrated_error(const PoseSettings& truth, const PoseSettings& believed,
                                       const System& system, const PoseErrorOptions& options) {
  const auto shown = project_spheroid(truth, {0, 0, options.depth_from}, kAxis);
  if (!shown) return std::nullopt;
  double worst = 0;
  for (const double sign : {1.0, -1.0}) {
    const double known_z = options.depth_from + sign * options.retinal_depth_error;
    const PoseSettings corrected =
        calibrate_pose(believed, *shown, kAxis, known_z).applied(believed);
    const auto error = error_over_field(truth, corrected, system, options);
    if (!error) return std::nullopt;
    worst = std::max(worst, *error);
  }
  return worst;
}

}  // namespace

void PoseErrorOptions::check() const {
  microscope.check();
  detail::require_positive(max_m, "max_m");
  detail::require(max_angle > 0 && max_angle < std::numbers::pi / 2,
                  "max_angle: must lie between 0 and 90 degrees");
  detail::require(depth_from >= 0 && depth_to > depth_from && std::isfinite(depth_to),
                  "depth_to: must be beyond depth_from");
  detail::require(angles >= 3 && angles <= 1000, "angles: must lie within 3 and 1000");
  detail::require(depths >= 3 && depths <= 1000, "depths: must lie within 3 and 1000");
  detail::require(retinal_depth_error >= 0 && retinal_depth_error <= depth_from,
                  "retinal_depth_error: must not be negative, nor more than depth_from");
}

/// The assumed eye's projection is fitted once, the true eye's for each eye.
EyeError pose_error(const Prescription& believed, const PoseErrorOptions& options) {
  options.check();
  if (!believed.system.stop) throw std::invalid_argument("stop: the system has none");
  const PoseSettings model = looking_through(believed.system, options);
  model.check();
  return [model, options](const Prescription& truth) -> std::optional<double> {
    try {
      const PoseSettings true_model = looking_through(truth.system, options);
      return options.calibrated ? calibrated_error(true_model, model, truth.system, options)
                                : error_over_field(true_model, model, truth.system, options);
    } catch (const std::invalid_argument&) {
      return std::nullopt;  // too few rays come through this eye, or no scale explains its retina
    }
  };
}

}  // namespace vitreo::optics
