// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/pose.h"

#include "optics/numerics/preconditions.h"
#include "optics/pose/ellipse_weight.h"
#include "optics/pose/silhouette.h"
#include "optics/projection/projection_model.h"

#include <Eigen/Dense>
#include <ceres/jet.h>
#include <ceres/tiny_solver.h>
#include <ceres/tiny_solver_autodiff_function.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo::optics {
namespace {

// the solver works in mm, so that steps in depth and across are of a size
constexpr double kMmPerM = 1e3;
using Jacobian = Eigen::Matrix<double, 5, 3>;

/// The terms of (5.15), in px: model less observation. With a weight, independent terms of unit
/// variance instead.
class EllipseResidual {
 public:
  EllipseResidual(const PoseSettings& settings, const EllipseVector& observed,
                  const Eigen::Vector3d& axis)
      : settings_(settings), circle_(settings.contour_points), observed_(observed), axis_(axis) {}
  // Null: the terms of (5.15) themselves, in px.
  void weigh(const detail::EllipseWeight* weight) { weight_ = weight; }

  template <class T>
  bool operator()(const T* position_mm, T* residuals) const {
    const detail::Vector3<T> position =
        detail::Vector3<T>(position_mm[0], position_mm[1], position_mm[2]) / kMmPerM;
    detail::ImageEllipse<T> shown;
    if (!detail::project_ellipse(settings_, circle_, position, axis_, shown)) {
      // TinySolver does not check whether an evaluation failed
      std::fill_n(residuals, 5, T(kOutside));
      return false;
    }
    if (weight_) {
      weighted_terms(shown, residuals);
      return true;
    }
    residuals[0] = shown.center.x() - observed_[0];
    residuals[1] = shown.center.y() - observed_[1];
    residuals[2] = shown.semi_major - observed_[2];
    residuals[3] = shown.semi_minor - observed_[3];
    residuals[4] = angle_term(shown);
    return true;
  }

 private:
  static constexpr double kOutside = 1e6;  // px; any step out there is refused

  template <class T>
  // Differences in smooth coordinates (ellipse_weight.h), by (a^2 - b^2) / 2 = (a + b) (a - b) / 2:
  // the shown second-harmonic vector over a + b.
  void weighted_terms(const detail::ImageEllipse<T>& shown, T* residuals) const {
    const T sum = shown.semi_major + shown.semi_minor;
    const double half = (observed_[2] - observed_[3]) / 2;
    const T difference[5] = {shown.center.x() - observed_[0], shown.center.y() - observed_[1],
                             (sum - observed_[2] - observed_[3]) / 2.0,
                             shown.twice_angle_cos / sum - half * std::cos(2 * observed_[4]),
                             shown.twice_angle_sin / sum - half * std::sin(2 * observed_[4])};
    for (int i = 0; i < 5; ++i) {
      residuals[i] = T(0);
      for (int j = 0; j < 5; ++j) residuals[i] += difference[j] * weight_->root(i, j);
    }
  }

  /// The angle's term of (5.15): half the model's difference of axes times the angle between model
  /// and observation, which is thus modulo pi and in px, and fades out where the model is a circle
  /// and has no angle.
  template <class T>
  T angle_term(const detail::ImageEllipse<T>& shown) const {
    using std::atan2;
    constexpr double kCircle = 1e-4;  // px^2
    const double cosine = std::cos(2 * observed_[4]);
    const double sine = std::sin(2 * observed_[4]);
    const T along = shown.twice_angle_cos * cosine + shown.twice_angle_sin * sine;
    const T across = shown.twice_angle_sin * cosine - shown.twice_angle_cos * sine;
    if (along * along + across * across < kCircle * kCircle) return T(0);
    return settings_.angle_weight * (shown.semi_major - shown.semi_minor) / 2.0 *
           atan2(across, along) / 2.0;
  }

  const PoseSettings& settings_;
  detail::Circle circle_;
  EllipseVector observed_;
  Eigen::Vector3d axis_;
  const detail::EllipseWeight* weight_ = nullptr;
};

using AutoDiff = ceres::TinySolverAutoDiffFunction<EllipseResidual, 5, 3>;
using Solver = ceres::TinySolver<AutoDiff>;

/// (5.15) does not invert it, so variances that are not negative suffice.
/// Throws std::invalid_argument naming the covariance; weighing needs more, which ellipse_weight
/// checks.
void check_covariance(const EllipseCovariance& covariance) {
  detail::require(covariance.allFinite(), "covariance: must be finite");
  detail::require(covariance.diagonal().minCoeff() >= 0, "covariance: has a negative variance");
  const double asymmetry = (covariance - covariance.transpose()).cwiseAbs().maxCoeff();
  if (asymmetry > 1e-9 * covariance.cwiseAbs().maxCoeff()) {
    throw std::invalid_argument("covariance: must be symmetric");
  }
}

/// Its sense does not matter: a spheroid is its own mirror image.
Eigen::Vector3d unit_axis(const Eigen::Vector3d& axis) {
  const double length = axis.norm();
  detail::require(std::isfinite(length) && length > 0, "axis_in_eye: must be finite and not zero");
  return axis / length;
}

bool inside(const PoseSettings& settings, const Eigen::Vector3d& position, double behind_retina) {
  return detail::ProjectionModel(settings.projection, settings.exact, settings.image)
      .inside(position, behind_retina);
}

/// The inverse of the information, m^2, of terms of unit variance.
/// The solver's J is by mm, hence the factor.
Eigen::Matrix3d in_m(const Eigen::Matrix3d& information) {
  return information.inverse() / (kMmPerM * kMmPerM);
}

/// Covariance of the position: (J^T C^-1 J)^-1 for the weighted estimator, whose residuals are
/// whitened; for (5.15) the observation's covariance C through the estimator, G C G^T with the gain
/// G = (J^T J)^-1 J^T D. D is the derivative of the residuals by the observation, up to sign.
/// Nothing when some direction is not observed at all.
/// `shown`: the model's ellipse at the minimum; its axes are in D, as the angle's term is half
/// their difference times the angle.
std::optional<Eigen::Matrix3d> propagate(const PoseSettings& settings, const EllipseVector& shown,
                                         const Jacobian& jacobian,
                                         const EllipseCovariance& covariance) {
  constexpr double kUnobserved = 1e-10;  // of the best observed direction's information
  const Eigen::Matrix3d information = jacobian.transpose() * jacobian;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spectrum(information);
  if (!(spectrum.eigenvalues()[0] > kUnobserved * spectrum.eigenvalues()[2])) return std::nullopt;
  if (settings.weighted) return in_m(information);
  EllipseVector residual_from_observed = EllipseVector::Ones();
  residual_from_observed[4] = settings.angle_weight * (shown[2] - shown[3]) / 2;
  const Eigen::Matrix<double, 3, 5> gain =
      information.inverse() * jacobian.transpose() * residual_from_observed.asDiagonal();
  return gain * covariance * gain.transpose() / (kMmPerM * kMmPerM);
}

/// atan2 gives twice the angle in [-pi, pi]; -pi and pi are one direction.
EllipseVector as_vector(const detail::ImageEllipse<double>& ellipse) {
  EllipseVector result;
  double angle = std::atan2(ellipse.twice_angle_sin, ellipse.twice_angle_cos) / 2;
  if (angle <= -std::numbers::pi / 2)
    angle = std::numbers::pi / 2;  // -0.0 beside a negative cosine
  result << ellipse.center, ellipse.semi_major, ellipse.semi_minor, angle;
  return result;
}

/// Position in mm and residuals in px, so the tolerances have these units.
Solver::Options solver_options() {
  Solver::Options options;
  options.max_num_iterations = 50;
  options.gradient_tolerance = 1e-9;
  options.parameter_tolerance = 1e-7;  // of some 10 mm: a nanometer
  options.function_tolerance = 1e-9;   // px^2
  options.cost_threshold = 1e-18;      // px^2
  return options;
}

}  // namespace

/// (5.14) and the ellipse of its silhouette.
std::optional<EllipseVector> project_spheroid(const PoseSettings& settings,
                                              const Eigen::Vector3d& position_in_eye,
                                              const Eigen::Vector3d& axis_in_eye) {
  settings.check();
  detail::require(position_in_eye.allFinite(), "position_in_eye: must be finite");
  const Eigen::Vector3d axis = unit_axis(axis_in_eye);
  if (!inside(settings, position_in_eye, 0)) return std::nullopt;
  detail::ImageEllipse<double> ellipse;
  const detail::Circle circle(settings.contour_points);
  if (!detail::project_ellipse(settings, circle, position_in_eye, axis, ellipse))
    return std::nullopt;
  return as_vector(ellipse);
}

/// (5.13).
std::optional<Eigen::Vector2d> shown_at(const PoseSettings& settings,
                                        const Eigen::Vector3d& point_in_eye) {
  detail::require(point_in_eye.allFinite(), "point_in_eye: must be finite");
  const detail::ProjectionModel camera(settings.projection, settings.exact, settings.image);
  if (!camera.inside(point_in_eye, settings.behind_retina)) return std::nullopt;
  return camera.pixel(point_in_eye);
}

/// Levenberg-Marquardt (Ceres' TinySolver) with automatic derivatives; thesis 5.5 minimizes (5.15)
/// by the same method.
/// There is a result only when all of this holds: converged, within the projection, residual below
/// max_residual_px, and every direction observed. Else the caller looks with another start, or has
/// lost the robot.
std::optional<PoseEstimate> locate(const PoseSettings& settings, const EllipseVector& observed,
                                   const EllipseCovariance& covariance,
                                   const Eigen::Vector3d& axis_in_eye,
                                   const Eigen::Vector3d& start_in_eye) {
  settings.check();
  detail::check_ellipse(observed);
  check_covariance(covariance);
  detail::require(start_in_eye.allFinite(), "start_in_eye: must be finite");
  EllipseResidual residual(settings, observed, unit_axis(axis_in_eye));
  detail::EllipseWeight weight;
  if (settings.weighted) {
    weight = detail::ellipse_weight(observed, covariance);
    residual.weigh(&weight);
  }
  const AutoDiff function(residual);
  Eigen::Vector3d position_mm = start_in_eye * kMmPerM;
  EllipseVector terms;
  if (!residual(position_mm.data(), terms.data())) return std::nullopt;
  Solver solver;
  solver.options = solver_options();
  solver.Solve(function, &position_mm);
  if (solver.summary.status == Solver::HIT_MAX_ITERATIONS || !position_mm.allFinite())
    return std::nullopt;
  PoseEstimate estimate;
  estimate.position_in_eye = position_mm / kMmPerM;
  estimate.iterations = solver.summary.iterations;
  if (!inside(settings, estimate.position_in_eye, settings.behind_retina)) return std::nullopt;
  Jacobian jacobian;
  if (!function(position_mm.data(), terms.data(), jacobian.data())) return std::nullopt;
  // The residual is reported in px, whatever the weights.
  residual.weigh(nullptr);
  if (!residual(position_mm.data(), terms.data())) return std::nullopt;
  estimate.residual_px = std::sqrt(terms.squaredNorm() / 5);
  if (!(estimate.residual_px <= settings.max_residual_px)) return std::nullopt;
  const auto spread = propagate(settings, observed + terms, jacobian, covariance);
  if (!spread) return std::nullopt;
  estimate.covariance = *spread;
  return estimate;
}

/// The image of a body that is larger by e has axes larger by e, to first order; that of a camera
/// whose pixels are larger by e is smaller by e about its center. The estimator answers by its gain
/// G = (J^T J)^-1 J^T D, as in propagate().
std::optional<PoseSensitivity> pose_sensitivity(const PoseSettings& settings,
                                                const Eigen::Vector3d& position_in_eye,
                                                const Eigen::Vector3d& axis_in_eye) {
  const auto shown = project_spheroid(settings, position_in_eye, axis_in_eye);
  if (!shown) return std::nullopt;
  const EllipseResidual residual(settings, *shown, unit_axis(axis_in_eye));
  const AutoDiff function(residual);
  const Eigen::Vector3d position_mm = position_in_eye * kMmPerM;
  EllipseVector terms;
  Jacobian jacobian;
  if (!function(position_mm.data(), terms.data(), jacobian.data())) return std::nullopt;
  const Eigen::FullPivLU<Eigen::Matrix3d> information(jacobian.transpose() * jacobian);
  if (!information.isInvertible()) return std::nullopt;
  EllipseVector larger = EllipseVector::Zero();
  larger.segment<2>(2) = shown->segment<2>(2);
  EllipseVector finer = -*shown;
  finer.head<2>() += settings.image.center_px;
  finer[4] = 0;
  const auto moved = [&](const EllipseVector& change) -> Eigen::Vector3d {
    return information.solve(jacobian.transpose() * change) / kMmPerM;
  };
  return PoseSensitivity{moved(larger), moved(finer)};
}

/// The shown size sqrt(a b) grows with z along the line of sight of the ellipse's center; bisection
/// for the observed size.
/// A fifth of tolerance at both ends, as an outline of few pixels on the retina may come out
/// somewhat too small for any depth.
std::optional<Eigen::Vector3d> first_guess(const PoseSettings& settings,
                                           const EllipseVector& observed,
                                           const Eigen::Vector3d& axis_in_eye) {
  constexpr double kTolerated = 1.2;
  constexpr int kHalvings = 24;  // of some 15 mm: a nanometer
  settings.check();
  detail::check_ellipse(observed);
  const Eigen::Vector3d axis = unit_axis(axis_in_eye);
  const detail::ProjectionModel camera(settings.projection, settings.exact, settings.image);
  const auto sight = camera.line_of_sight(observed.head<2>());
  if (!sight) return std::nullopt;
  const auto on_line = [&](double z) -> Eigen::Vector3d {
    return sight->origin + (z - sight->origin.z()) / sight->direction.z() * sight->direction;
  };
  const detail::Circle circle(settings.contour_points);
  const double wanted = std::sqrt(observed[2] * observed[3]);
  // shown size over observed; growing with z; beyond the projection it is too large
  const auto excess = [&](double z) {
    detail::ImageEllipse<double> shown;
    if (!detail::project_ellipse(settings, circle, on_line(z), axis, shown)) return 2 * kTolerated;
    return std::sqrt(shown.semi_major * shown.semi_minor) / wanted;
  };
  double low = -settings.behind_retina;
  double high = camera.max_z();
  if (excess(low) > kTolerated || excess(high) < 1 / kTolerated) return std::nullopt;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (low + high) / 2;
    (excess(middle) < 1 ? low : high) = middle;
  }
  return on_line((low + high) / 2);
}

}  // namespace vitreo::optics
