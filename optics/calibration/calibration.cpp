// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/calibration.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/first_order.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace {

constexpr double kPole = 1e-9;  // m; this near to its pole the law gives nothing

void check_point(const OnAxisPoint& point, const char* name) {
  if (!std::isfinite(point.sensor) || !std::isfinite(point.object)) {
    throw std::invalid_argument(std::string(name) + ": must be finite");
  }
}

/// (4.10) to (4.12): d_o and its derivatives by f, PP1, PP2; false at the pole s_i = f. By (4.11)
/// ds_o/df = -n_v s_i^2 / (s_i - f)^2 and ds_o/ds_i = n_v f^2 / (s_i - f)^2; PP2 enters s_i with a
/// minus.
bool derivatives(const OnAxisLaw& law, double d_ls, double& d_o, Eigen::Vector3d& by) {
  const double s_i = d_ls - law.second_principal_point + law.sensor_shift;
  const double f = law.focal_length;
  const double rest = s_i - f;
  if (std::abs(rest) < kPole) return false;
  d_o = -f * law.object_index * s_i / rest + law.first_principal_point + law.object_shift;
  const double by_s_i = law.object_index * f * f / (rest * rest);
  by = {-law.object_index * s_i * s_i / (rest * rest), 1, -by_s_i};
  return true;
}

/// Sums over the points: J^T J, J^T r, and the squares and the largest of r.
/// One pass over the points, in m and m^2; J has the columns f, PP1, PP2.
struct Normal {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  Eigen::Vector3d vector = Eigen::Vector3d::Zero();
  double squares = 0;
  double largest = 0;
};

/// Normal equations J^T J, J^T r of the residuals of d_o at the law; false when a point falls on
/// its pole.
bool linearize(const OnAxisLaw& law, std::span<const OnAxisPoint> points, Normal& normal) {
  normal = {};
  for (const OnAxisPoint& point : points) {
    double d_o = 0;
    Eigen::Vector3d by;
    if (!derivatives(law, point.sensor, d_o, by)) return false;
    const double residual = point.object - d_o;
    normal.matrix += by * by.transpose();
    normal.vector += by * residual;
    normal.squares += residual * residual;
    normal.largest = std::max(normal.largest, std::abs(residual));
  }
  return true;
}

/// A step in (f, PP1, PP2).
OnAxisLaw moved(OnAxisLaw law, const Eigen::Vector3d& step) {
  law.focal_length += step[0];
  law.first_principal_point += step[1];
  law.second_principal_point += step[2];
  return law;
}

/// A fit of three parameters needs three abscissas.
/// Otherwise J^T J is singular and the fit would return whatever the damping leaves. Positions of
/// the sensor nearer than 0.1 um are one position.
void check_points(std::span<const OnAxisPoint> points) {
  constexpr double kDistinct = 1e-7;  // m
  std::vector<double> sensors;
  for (const OnAxisPoint& point : points) {
    check_point(point, "points");
    sensors.push_back(point.sensor);
  }
  std::sort(sensors.begin(), sensors.end());
  const auto same = [](double a, double b) { return std::abs(a - b) < kDistinct; };
  if (std::unique(sensors.begin(), sensors.end(), same) - sensors.begin() < 3) {
    throw std::invalid_argument("points: f, PP1 and PP2 need three of different sensor positions");
  }
}

/// Levenberg-Marquardt with Marquardt's scaling by the diagonal, for the refinement of f, PP1 and
/// PP2 (thesis 4.3).
/// The three parameters are lengths and so are the residuals, which is why one threshold serves the
/// step. A start with a pole between the points is refused, as least squares cannot step over it.
Normal minimize(OnAxisLaw& law, std::span<const OnAxisPoint> points) {
  constexpr int kSteps = 200;
  constexpr double kSmall = 1e-13;  // m
  Normal at;
  if (!linearize(law, points, at))
    throw std::invalid_argument("points: the start of the fit has its pole there");
  double damping = 1e-6;
  for (int i = 0; i < kSteps; ++i) {
    Eigen::Matrix3d damped = at.matrix;
    damped.diagonal() *= 1 + damping;
    const Eigen::Vector3d step = damped.ldlt().solve(at.vector);
    if (!step.allFinite()) break;
    Normal next;
    const OnAxisLaw tried = moved(law, step);
    // Accepted when the squares do not grow: less damping then, more otherwise.
    if (linearize(tried, points, next) && next.squares <= at.squares) {
      law = tried;
      at = next;
      damping = std::max(damping / 10, 1e-15);
      if (step.norm() < kSmall) return at;
    } else {
      if (step.norm() < kSmall) return at;
      damping *= 10;
    }
  }
  throw std::invalid_argument("points: the fit does not converge; they do not follow a lens' law");
}

/// Smallest (e_dls, e_do) that fulfills the law at the retina: Newton's method, each time the point
/// nearest to zero on the linearized constraint g . e = rest, e = g rest / |g|^2.
/// By (4.10) and (4.12) the gradient of d_o by (e_dls, e_do) is (ds_o/ds_i, 1), and `by` holds
/// -ds_o/ds_i for PP2.
void minimum_norm(OnAxisLaw& law, const OnAxisPoint& retina) {
  constexpr int kSteps = 100;
  constexpr double kSmall = 1e-15;  // m
  for (int i = 0; i < kSteps; ++i) {
    double d_o = 0;
    Eigen::Vector3d by;
    if (!derivatives(law, retina.sensor, d_o, by)) break;
    const Eigen::Vector2d gradient(-by[2], 1);
    const Eigen::Vector2d now(law.sensor_shift, law.object_shift);
    const Eigen::Vector2d next =
        gradient * ((gradient.dot(now) + retina.object - d_o) / gradient.squaredNorm());
    if (!next.allFinite()) break;
    law.sensor_shift = next[0];
    law.object_shift = next[1];
    if ((next - now).norm() < kSmall) return;
  }
  throw std::invalid_argument("retina: the law cannot be brought there");
}

}  // namespace

void OnAxisLaw::check() const {
  const auto finite = [](const char* name, double value) {
    if (!std::isfinite(value)) throw std::invalid_argument(std::string(name) + ": must be finite");
  };
  finite("focal_length", focal_length);
  finite("first_principal_point", first_principal_point);
  finite("second_principal_point", second_principal_point);
  finite("sensor_shift", sensor_shift);
  finite("object_shift", object_shift);
  if (focal_length == 0) throw std::invalid_argument("focal_length: must not be zero");
  detail::require(object_index >= 1, "object_index: must be at least 1");
}

/// Nothing at the pole s_i = f, where the object is at infinity.
std::optional<double> OnAxisLaw::object_from_sensor(double d_ls) const {
  double d_o = 0;
  Eigen::Vector3d by;
  if (!derivatives(*this, d_ls, d_o, by) || !std::isfinite(d_o)) return std::nullopt;
  return d_o;
}

/// Inverse of (4.10) to (4.12): s_i = s_o f / (s_o + f n_v).
std::optional<double> OnAxisLaw::sensor_from_object(double d_o) const {
  const double s_o = d_o - first_principal_point - object_shift;
  const double rest = s_o + focal_length * object_index;  // (4.11) solved for s_i
  if (!(std::abs(rest) >= kPole)) return std::nullopt;
  return s_o * focal_length / rest + second_principal_point - sensor_shift;
}

/// (4.6) to (4.9): the paraxial start that thesis 4.3 refines.
OnAxisLaw on_axis_law(const System& system) {
  const auto points = cardinal_points(system);
  if (!points) throw std::invalid_argument("system: it is afocal");
  return {points->focal_length,
          points->first_principal_point,
          points->second_principal_point,
          system.surfaces.front().index,
          0,
          0};
}

/// Thesis 4.3, "we use the paraxial calculations as an initial estimation, and perform a
/// minimization".
/// Least squares of d_o, the depth in the eye: an error of the sensor's position counts by what it
/// does to the depth.
OnAxisFit fit_on_axis(const OnAxisLaw& start, std::span<const OnAxisPoint> points) {
  start.check();
  check_points(points);
  OnAxisFit fit{start, 0, 0, Eigen::Matrix3d::Zero()};
  // e_do and e_dls act as shifts of PP1 and PP2, so they are no parameters beside them.
  fit.law.first_principal_point += fit.law.object_shift;
  fit.law.second_principal_point -= fit.law.sensor_shift;
  fit.law.object_shift = fit.law.sensor_shift = 0;
  const Normal at = minimize(fit.law, points);
  const auto count = static_cast<double>(points.size());
  fit.rms_residual = std::sqrt(at.squares / count);
  fit.max_residual = at.largest;
  // (J^T J)^-1 times the residual variance, with n - 3 degrees of freedom.
  if (points.size() > 3) fit.covariance = at.matrix.inverse() * (at.squares / (count - 3));
  return fit;
}

/// Thesis 4.3: e_dls and e_do from one equation, the retina's. With e_dls alone it is solved by the
/// inverse law, exactly.
/// The residual is computed from the finished law, so it also proves the inverse.
BiometricFit calibrate_biometric(const OnAxisLaw& law, const OnAxisPoint& retina,
                                 BiometricMethod method) {
  law.check();
  check_point(retina, "retina");
  BiometricFit fit{law, 0};
  if (method == BiometricMethod::minimum_norm) {
    minimum_norm(fit.law, retina);
  } else {
    fit.law.sensor_shift = 0;
    const auto sensor = fit.law.sensor_from_object(retina.object);
    if (!sensor) throw std::invalid_argument("retina: the law has its image at infinity there");
    fit.law.sensor_shift = *sensor - retina.sensor;
  }
  const auto seen = fit.law.object_from_sensor(retina.sensor);
  if (!seen) throw std::invalid_argument("retina: the law cannot be brought there");
  fit.residual = std::abs(*seen - retina.object);
  return fit;
}

}  // namespace vitreo::optics
