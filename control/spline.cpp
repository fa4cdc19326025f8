// Natural cubic spline trajectory through waypoints, parametrized by chord length.
// SPDX-License-Identifier: Apache-2.0
#include "control/preconditions.h"
#include "control/trajectory.h"

#include <algorithm>

namespace vitreo::control {
namespace {

using Points = std::vector<Eigen::Vector3d>;

// Second derivatives M_k at the points (de Boor 2001, chapter IV): continuity of the first
// derivative at each inner point, with h_k the distance from point k to k + 1, is
//   h_(k-1) M_(k-1) + 2 (h_(k-1) + h_k) M_k + h_k M_(k+1)
//     = 6 ((p_(k+1) - p_k) / h_k - (p_k - p_(k-1)) / h_(k-1)),
// and M = 0 at both ends ("natural"). Tridiagonal and diagonally dominant: Thomas' elimination
// without pivoting is stable.
// `at` is the arc length by chords, strictly increasing; n is at least 3.
Points second_derivatives(const Points& p, const std::vector<double>& at) {
  const std::size_t n = p.size();
  Points second(n, Eigen::Vector3d::Zero());
  std::vector<double> ratio(n, 0);
  for (std::size_t k = 1; k + 1 < n; ++k) {
    const double before = at[k] - at[k - 1];
    const double after = at[k + 1] - at[k];
    const double pivot = 2 * (before + after) - before * ratio[k - 1];
    ratio[k] = after / pivot;
    second[k] =
        (6 * ((p[k + 1] - p[k]) / after - (p[k] - p[k - 1]) / before) - before * second[k - 1]) /
        pivot;
  }
  // Back substitution.
  for (std::size_t k = n - 1; k-- > 1;) second[k] -= ratio[k] * second[k + 1];
  return second;
}

}  // namespace

// Repeated points are dropped, as they would have no length to divide by. The limits are kept by
// curve(), which samples the spline.
Trajectory Trajectory::spline(const std::vector<Eigen::Vector3d>& points,
                              const MotionLimits& limits) {
  Points p;
  for (const Eigen::Vector3d& point : points) {
    require(point.allFinite(), "waypoints: a number is not finite");
    if (p.empty() || point != p.back()) p.push_back(point);
  }
  // Two points are a straight line.
  if (p.size() < 3) return waypoints(points, limits);
  std::vector<double> at{0};
  for (std::size_t k = 1; k < p.size(); ++k) at.push_back(at.back() + (p[k] - p[k - 1]).norm());
  const Points second = second_derivatives(p, at);
  return curve(
      [&](double t) {
        const double x = t * at.back();
        const auto next = std::upper_bound(at.begin() + 1, at.end() - 1, x);
        const auto k = static_cast<std::size_t>(next - at.begin());
        // The cubic of the segment, in terms of its ends' positions and second derivatives.
        const double h = at[k] - at[k - 1];
        const double v = (at[k] - x) / h;
        const double u = 1 - v;
        return Eigen::Vector3d(v * p[k - 1] + u * p[k] +
                               h * h / 6 *
                                   ((v * v * v - v) * second[k - 1] + (u * u * u - u) * second[k]));
      },
      limits);
}

}  // namespace vitreo::control
