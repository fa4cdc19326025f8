// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/clearance/predictive.h"

#include <algorithm>
#include <cmath>

namespace vitreo::approaches {
namespace {

constexpr double kScale = 1e-3;  // m/s, m: rows of both kinds of constraint are of order one

/// A, by the amplifier, and by R I^2 t / C + what leaves through R_th up to the limit.
double largest_current(const PredictiveSettings& settings) {
  const double span = settings.frames * settings.period;
  const double power =
      settings.heat_capacity * (settings.temperature_limit - settings.temperature) / span +
      settings.temperature / settings.thermal_resistance;
  return std::min(settings.current, std::sqrt(std::max(power, 0.0) / settings.resistance));
}

struct Constraints {
  Eigen::MatrixXd rows;  // rows x <= limits
  Eigen::VectorXd limits;
};

Constraints constraints_of(const PredictiveSettings& settings, const control::Clearance& clearance,
                           const Eigen::Vector3d& disturbance, double response,
                           const CurrentMap& currents) {
  const int frames = settings.frames;
  const auto coils = static_cast<int>(currents.rest.size());
  Constraints made;
  made.rows = Eigen::MatrixXd::Zero(2 * frames + 2 * coils * frames, 3 * frames);
  made.limits.resize(made.rows.rows());
  const double most = largest_current(settings);
  int row = 0;
  for (const control::WallClearance* const wall : {&clearance.retina, &clearance.lens}) {
    for (int k = 1; k <= frames; ++k, ++row) {
      for (int j = 0; j < k; ++j)
        made.rows.block<1, 3>(row, 3 * j) = -settings.period * response * wall->normal.transpose();
      made.limits[row] =
          (wall->bound() - settings.margin + k * settings.period * wall->normal.dot(disturbance)) /
          kScale;
    }
  }
  for (int k = 0; k < frames; ++k)
    for (int coil = 0; coil < coils; ++coil)
      for (const double sign : {1.0, -1.0}) {
        made.rows.block<1, 3>(row, 3 * k) = sign * kScale * currents.slope.row(coil);
        made.limits[row] = most - sign * currents.rest[coil];
        ++row;
      }
  return made;
}

}  // namespace

PredictiveResult predictive_keep_out(const PredictiveSettings& settings,
                                     const control::Clearance& clearance,
                                     const Eigen::Vector3d& wanted,
                                     const Eigen::Vector3d& disturbance, double response,
                                     const CurrentMap& currents) {
  constexpr int kMostSweeps = 200;
  constexpr double kSettled = 1e-6;
  const Constraints made = constraints_of(settings, clearance, disturbance, response, currents);
  Eigen::VectorXd x(3 * settings.frames);  // mm/s
  for (int k = 0; k < settings.frames; ++k) x.segment<3>(3 * k) = wanted / kScale;
  Eigen::VectorXd multipliers = Eigen::VectorXd::Zero(made.rows.rows());
  PredictiveResult result;
  for (result.sweeps = 1; result.sweeps <= kMostSweeps; ++result.sweeps) {
    double moved = 0;
    for (Eigen::Index row = 0; row < made.rows.rows(); ++row) {
      const double size = made.rows.row(row).squaredNorm();
      if (!(size > 0)) continue;
      const double step =
          std::max(-multipliers[row], (made.rows.row(row).dot(x) - made.limits[row]) / size);
      if (step == 0) continue;
      multipliers[row] += step;
      x -= step * made.rows.row(row).transpose();
      moved = std::max(moved, std::abs(step) * std::sqrt(size));
    }
    if (moved < kSettled) break;
  }
  result.violation = std::max(0.0, (made.rows * x - made.limits).maxCoeff());
  result.velocity = x.head<3>() * kScale;
  return result;
}

}  // namespace vitreo::approaches
