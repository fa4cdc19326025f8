// SPDX-License-Identifier: Apache-2.0
#include "control/field_fit.h"

#include "control/constants.h"
#include "control/field_least_squares.h"

#include <ceres/cost_function.h>

#include <cmath>
#include <memory>
#include <utility>

namespace vitreo::control {
namespace {

// With these units all columns of the Jacobian are of like size.
constexpr double kMomentUnit = 100;  // A m^2/A: brings moments to the size of positions in m

// The unknowns x: of each coil position (m) and moment (kMomentUnit), then the background
// (kFieldUnit).
// Inverse of what fit_dipoles() puts into x; positions in m, world.
CoilField dipoles_from(const double* x, int coils) {
  std::vector<Dipole> dipoles;
  for (int k = 0; k < coils; ++k, x += 6) {
    dipoles.push_back(
        {Eigen::Vector3d(x[0], x[1], x[2]), kMomentUnit * Eigen::Vector3d(x[3], x[4], x[5])});
  }
  return CoilField(std::move(dipoles));
}

// r = B(p) I + b - B_measured of all readings, one dense block with analytic derivatives. Moments
// and background enter linearly. Moving a dipole by dp moves every field point by -dp relative to
// it, so dB/dp_dipole = -G, the field's gradient, which the model has anyway.
class DipoleResiduals final : public ceres::CostFunction {
 public:
  DipoleResiduals(const std::vector<ProbeReading>& readings, int coils)
      : readings_(readings), coils_(coils) {
    set_num_residuals(static_cast<int>(3 * readings.size()));
    mutable_parameter_block_sizes()->push_back(6 * coils + 3);
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const double* x = parameters[0];
    const int unknowns = 6 * coils_ + 3;
    // A step that went wrong: Ceres then tries a shorter one.
    for (int i = 0; i < unknowns; ++i) {
      if (!std::isfinite(x[i])) return false;
    }
    const CoilField field = dipoles_from(x, coils_);
    const Eigen::Map<const Eigen::Vector3d> background(x + 6 * coils_);
    Eigen::Map<Jacobian> jacobian(jacobians ? jacobians[0] : nullptr,
                                  jacobians ? num_residuals() : 0, unknowns);
    for (std::size_t n = 0; n < readings_.size(); ++n) {
      const ProbeReading& reading = readings_[n];
      const FieldMatrix matrix = field.matrix(reading.position);
      const Eigen::Vector3d model = matrix.topRows<3>() * reading.currents;
      Eigen::Map<Eigen::Vector3d>(residuals + 3 * n) =
          (model - reading.field) / kFieldUnit + background;
      if (!jacobians || !jacobians[0]) continue;
      const auto row = static_cast<Eigen::Index>(3 * n);
      for (int k = 0; k < coils_; ++k) {
        const double current = reading.currents[k] / kFieldUnit;
        jacobian.block<3, 3>(row, 6 * k) = -current * gradient_matrix(matrix.col(k));
        jacobian.block<3, 3>(row, 6 * k + 3) =
            current * kMomentUnit *
            by_moment(reading.position - field.dipoles()[static_cast<std::size_t>(k)].position);
      }
      jacobian.block<3, 3>(row, 6 * coils_).setIdentity();
    }
    return true;
  }

 private:
  // D(r) of B = D(r) m: the dipole's field is linear in its moment.
  static Eigen::Matrix3d by_moment(const Eigen::Vector3d& r) {
    const double square = r.squaredNorm();
    const double cube = square * std::sqrt(square);
    return kMu0Over4Pi / cube * (3 / square * r * r.transpose() - Eigen::Matrix3d::Identity());
  }

  const std::vector<ProbeReading>& readings_;
  int coils_;
};

}  // namespace

// Throws as check_readings. A fit that does not converge is returned with `converged` false: its
// residuals show how far off it is.
DipoleFit fit_dipoles(const CoilField& start, const std::vector<ProbeReading>& readings) {
  const int coils = start.coils();
  // 6 n + 3 unknowns, three numbers a reading.
  check_readings(readings, coils, static_cast<std::size_t>(2 * coils + 1));
  std::vector<double> x;
  for (const Dipole& dipole : start.dipoles()) {
    x.insert(x.end(), dipole.position.begin(), dipole.position.end());
    for (const double m : dipole.moment_per_ampere) x.push_back(m / kMomentUnit);
  }
  x.resize(x.size() + 3, 0);
  const bool converged = solve_least_squares(std::make_unique<DipoleResiduals>(readings, coils), x);
  const double* background = x.data() + 6 * coils;
  DipoleFit fit{dipoles_from(x.data(), coils),
                kFieldUnit * Eigen::Vector3d(background[0], background[1], background[2])};
  fit.converged = converged;
  const ResidualReport residual = residual_report(readings, [&fit](const ProbeReading& reading) {
    return Eigen::Vector3d(fit.field.matrix(reading.position).topRows<3>() * reading.currents +
                           fit.background);
  });
  fit.residual_rms = residual.rms;
  fit.residual_largest = residual.largest;
  fit.worst_reading = residual.worst;
  fit.residual_relative = residual.relative;
  return fit;
}

}  // namespace vitreo::control
