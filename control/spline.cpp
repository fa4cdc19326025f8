// The natural cubic spline through waypoints, by their distances.
// SPDX-License-Identifier: Apache-2.0
#include "control/trajectory.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo::control {
namespace {

using Points = std::vector<Eigen::Vector3d>;

// Second derivatives at the points: a tridiagonal system, nothing at both ends (Thomas'
// elimination).
Points second_derivatives(const Points& p, const std::vector<double>& at) {
  const std::size_t n = p.size();
  Points second(n, Eigen::Vector3d::Zero());
  std::vector<double> ratio(n, 0);
  for (std::size_t k = 1; k + 1 < n; ++k) {
    const double before = at[k] - at[k - 1], after = at[k + 1] - at[k];
    const double pivot = 2 * (before + after) - before * ratio[k - 1];
    ratio[k] = after / pivot;
    second[k] =
        (6 * ((p[k + 1] - p[k]) / after - (p[k] - p[k - 1]) / before) - before * second[k - 1]) /
        pivot;
  }
  for (std::size_t k = n - 1; k-- > 1;) second[k] -= ratio[k] * second[k + 1];
  return second;
}

}  // namespace

Trajectory Trajectory::spline(const std::vector<Eigen::Vector3d>& points,
                              const MotionLimits& limits) {
  Points p;
  for (const Eigen::Vector3d& point : points) {
    if (!point.allFinite()) throw std::invalid_argument("waypoints: a number is not finite");
    if (p.empty() || point != p.back()) p.push_back(point);
  }
  if (p.size() < 3) return waypoints(points, limits);
  std::vector<double> at{0};
  for (std::size_t k = 1; k < p.size(); ++k) at.push_back(at.back() + (p[k] - p[k - 1]).norm());
  const Points second = second_derivatives(p, at);
  return curve(
      [&](double t) {
        const double x = t * at.back();
        const auto next = std::upper_bound(at.begin() + 1, at.end() - 1, x);
        const auto k = static_cast<std::size_t>(next - at.begin());
        const double h = at[k] - at[k - 1], v = (at[k] - x) / h, u = 1 - v;
        return Eigen::Vector3d(v * p[k - 1] + u * p[k] +
                               h * h / 6 *
                                   ((v * v * v - v) * second[k - 1] + (u * u * u - u) * second[k]));
      },
      limits);
}

}  // namespace vitreo::control
