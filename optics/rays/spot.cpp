// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/spot.h"

#include "optics/numerics/preconditions.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <stdexcept>

namespace vitreo::optics {

/// sqrt(var x + 2 s cov(x, u) + s^2 var u), summed over both transverse directions.
/// At `distance` behind the last vertex, m; no pass over the rays is needed.
double SpotMoments::rms(double distance) const {
  const double square =
      position.trace() + distance * (2 * position_slope.trace() + distance * slope.trace());
  return std::sqrt(std::max(square, 0.0));  // rounding may leave less than nothing
}

/// A ray is straight behind the last surface.
std::vector<Eigen::Vector2d> Spot::at(double distance) const {
  std::vector<Eigen::Vector2d> points(position.size());
  for (std::size_t i = 0; i < position.size(); ++i) points[i] = position[i] + distance * slope[i];
  return points;
}

/// Two passes, means first: the covariances are differences of nearly equal numbers otherwise.
/// cov(position, slope) is made symmetric, as only x^T C x of it is used.
SpotMoments Spot::moments() const {
  SpotMoments m;
  m.rays = rays();
  if (m.rays == 0) return m;
  for (std::size_t i = 0; i < position.size(); ++i) m.mean += position[i], m.mean_slope += slope[i];
  m.mean /= m.rays;
  m.mean_slope /= m.rays;
  for (std::size_t i = 0; i < position.size(); ++i) {
    const Eigen::Vector2d p = position[i] - m.mean;
    const Eigen::Vector2d t = slope[i] - m.mean_slope;
    m.position += p * p.transpose();
    m.position_slope += (p * t.transpose() + t * p.transpose()) / 2;
    m.slope += t * t.transpose();
  }
  m.position /= m.rays;
  m.position_slope /= m.rays;
  m.slope /= m.rays;
  return m;
}

/// |mean of exp(-2 pi i f . p)|: the transform of a spread of points of equal weight.
/// `frequency` in cycles per m; geometric, so without diffraction.
double geometric_mtf(const Spot& spot, double distance, const Eigen::Vector2d& frequency) {
  if (spot.rays() == 0) return 0;
  // the phase stays small; its modulus does not care
  const Eigen::Vector2d center = spot.chief_at(distance);
  std::complex<double> sum = 0;
  for (const Eigen::Vector2d& p : spot.at(distance)) {
    sum += std::polar(1.0, -2 * std::numbers::pi * frequency.dot(p - center));
  }
  return std::abs(sum) / spot.rays();
}

/// A histogram of the spot about its mean.
/// Cells are counted from the lower edge, cells / 2 being the mean; the share in them may sum up to
/// less than 1.
Eigen::MatrixXd geometric_psf(const Spot& spot, double distance, double half_width, int cells) {
  detail::require_positive(half_width, "half_width");
  detail::require_at_least(cells, 1, "cells");
  Eigen::MatrixXd psf = Eigen::MatrixXd::Zero(cells, cells);
  if (spot.rays() == 0) return psf;
  const Eigen::Vector2d center = spot.moments().mean_at(distance);
  for (const Eigen::Vector2d& p : spot.at(distance)) {
    const Eigen::Vector2d cell = (p - center).array() / (2 * half_width) * cells + cells / 2.0;
    if (cell.minCoeff() < 0 || cell.maxCoeff() >= cells) continue;
    psf(static_cast<Eigen::Index>(cell.y()), static_cast<Eigen::Index>(cell.x())) +=
        1.0 / spot.rays();
  }
  return psf;
}

}  // namespace vitreo::optics
