// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/microscope_calibration.h"

#include "optics/calibration/camera_calibration.h"

#include <Eigen/Dense>
#include <ceres/jet.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace vitreo::optics {
namespace {

/// Pixels a m, power, tilt x and y, center u and v, rotation.
constexpr int kUnknowns = 7;
using Numbers = Eigen::Matrix<double, kUnknowns, 1>;
using TargetJet = ceres::Jet<double, kUnknowns>;

/// The pixel that shows a point: in the microscope's own frame Q = R' P lies on the chief ray of
/// m = (Q_x, Q_y) / (1 - power Q_z).
Eigen::Matrix<TargetJet, 2, 1> shown_by(const Numbers& numbers, const Eigen::Vector3d& position) {
  Eigen::Matrix<TargetJet, kUnknowns, 1> n;
  for (int i = 0; i < kUnknowns; ++i) n[i] = TargetJet(numbers[i], i);
  const TargetJet cx = cos(n[2]);
  const TargetJet sx = sin(n[2]);
  const TargetJet cy = cos(n[3]);
  const TargetJet sy = sin(n[3]);
  // R = R_y R_x, so R' takes P about y first, both the other way.
  const TargetJet across = cy * position.x() - sy * position.z();
  const TargetJet up = sy * position.x() + cy * position.z();
  const TargetJet qy = cx * position.y() + sx * up;
  const TargetJet qz = cx * up - sx * position.y();
  const TargetJet scale = n[0] / (1.0 - n[1] * qz);
  const TargetJet u = scale * across;
  const TargetJet v = -scale * qy;
  const TargetJet c = cos(n[6]);
  const TargetJet s = sin(n[6]);
  return {n[4] + c * u - s * v, n[5] + s * u + c * v};
}

/// Scale, center and rotation of all points as if they lay in one plane: right but for what pupil
/// and tilt do, some percent.
Numbers start_of(std::span<const TargetPoint> points) {
  std::vector<PointPair> flat;
  flat.reserve(points.size());
  for (const TargetPoint& one : points)
    flat.push_back({{-one.position.x(), -one.position.y()}, one.pixel_px});
  const CameraFit fit = fit_camera(flat);  // of an inverted image
  Numbers start;
  start << 1 / fit.image.pixel, 0, 0, 0, fit.image.center_px, fit.rotation;
  return start;
}

void check_points(std::span<const TargetPoint> points) {
  if (points.size() < 5) throw std::invalid_argument("points: seven numbers need five of them");
  double low = points.front().position.z();
  double high = low;
  for (const TargetPoint& one : points) {
    if (!one.position.allFinite() || !one.pixel_px.allFinite())
      throw std::invalid_argument("points: must be finite");
    low = std::min(low, one.position.z());
    high = std::max(high, one.position.z());
  }
  if (!(high - low > 1e-6))
    throw std::invalid_argument(
        "points: all at one height, where pupil and tilt do not show: wants two heights");
}

struct Residuals {
  Eigen::VectorXd of_pixels;
  Eigen::MatrixXd by_numbers;
};

Residuals residuals_at(const Numbers& numbers, std::span<const TargetPoint> points) {
  const auto rows = static_cast<Eigen::Index>(2 * points.size());
  Residuals made{Eigen::VectorXd(rows), Eigen::MatrixXd(rows, kUnknowns)};
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto seen = shown_by(numbers, points[i].position);
    for (int k = 0; k < 2; ++k) {
      const auto row = static_cast<Eigen::Index>(2 * i) + k;
      made.of_pixels[row] = seen[k].a - points[i].pixel_px[k];
      made.by_numbers.row(row) = seen[k].v.transpose();
    }
  }
  return made;
}

}  // namespace

/// Gauss-Newton with columns of equal norm: the numbers' units differ by seven orders.
MicroscopeFit fit_microscope(std::span<const TargetPoint> points) {
  check_points(points);
  constexpr int kSteps = 30;
  constexpr double kConverged = 1e-10;  // px, rms of the image that a step moves
  Numbers numbers = start_of(points);
  bool settled = false;
  Residuals at = residuals_at(numbers, points);
  for (int step = 0; step < kSteps && !settled; ++step) {
    const Numbers norms = at.by_numbers.colwise().norm();
    const Eigen::MatrixXd scaled = at.by_numbers * norms.cwiseInverse().asDiagonal();
    const Numbers move = scaled.colPivHouseholderQr().solve(at.of_pixels);
    numbers -= move.cwiseQuotient(norms);
    if (!numbers.allFinite()) break;
    settled = move.norm() < kConverged * std::sqrt(static_cast<double>(points.size()));
    at = residuals_at(numbers, points);
  }
  if (!settled) throw std::invalid_argument("points: no microscope shows them so");
  const double spare = static_cast<double>(2 * points.size()) - kUnknowns;
  const double variance = at.of_pixels.squaredNorm() / spare;
  const Eigen::MatrixXd covariance =
      variance * (at.by_numbers.transpose() * at.by_numbers).inverse();
  const Numbers sigma = covariance.diagonal().cwiseSqrt();
  MicroscopeFit fit;
  fit.pixel = 1 / numbers[0];
  fit.pixel_sigma = sigma[0] * fit.pixel * fit.pixel;
  fit.pupil_power = numbers[1];
  fit.pupil_power_sigma = sigma[1];
  fit.tilt = numbers.segment<2>(2);
  fit.tilt_sigma = sigma.segment<2>(2);
  fit.center_px = numbers.segment<2>(4);
  fit.center_sigma_px = sigma.segment<2>(4);
  fit.rotation = std::remainder(numbers[6], 2 * M_PI);
  fit.rotation_sigma = sigma[6];
  fit.rms_residual_px = std::sqrt(at.of_pixels.squaredNorm() / static_cast<double>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i)
    fit.max_residual_px = std::max(
        fit.max_residual_px, at.of_pixels.segment<2>(static_cast<Eigen::Index>(2 * i)).norm());
  return fit;
}

}  // namespace vitreo::optics
