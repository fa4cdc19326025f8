// One dense residual block with its own derivatives: the field's gradient is that by the dipole's
// place, negative.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_fit.h"

#include <ceres/cost_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <cmath>
#include <utility>

namespace vitreo::control {
namespace {

constexpr double kMu0Over4Pi = 1e-7;     // T m/A
constexpr double kMomentUnit = 100;      // A m^2/A: brings moments to the size of positions in m
constexpr double kFieldUnit = 1e-3;      // T: residuals of about one
using Parameters = std::vector<double>;  // per coil position (m) and moment (kMomentUnit), then
                                         // background (kFieldUnit)
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

CoilField field_of(const double* x, int coils) {
  std::vector<Dipole> dipoles;
  for (int k = 0; k < coils; ++k, x += 6) {
    dipoles.push_back(
        {Eigen::Vector3d(x[0], x[1], x[2]), kMomentUnit * Eigen::Vector3d(x[3], x[4], x[5])});
  }
  return CoilField(std::move(dipoles));
}

class Residuals final : public ceres::CostFunction {
 public:
  Residuals(const std::vector<ProbeReading>& readings, int coils)
      : readings_(readings), coils_(coils) {
    set_num_residuals(static_cast<int>(3 * readings.size()));
    mutable_parameter_block_sizes()->push_back(6 * coils + 3);
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const double* x = parameters[0];
    const int unknowns = 6 * coils_ + 3;
    for (int i = 0; i < unknowns; ++i) {
      if (!std::isfinite(x[i])) return false;
    }
    const CoilField field = field_of(x, coils_);
    const Eigen::Map<const Eigen::Vector3d> background(x + 6 * coils_);
    Eigen::Map<RowMajor> jacobian(jacobians ? jacobians[0] : nullptr,
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
  // B = D(r) m.
  static Eigen::Matrix3d by_moment(const Eigen::Vector3d& r) {
    const double square = r.squaredNorm(), cube = square * std::sqrt(square);
    return kMu0Over4Pi / cube * (3 / square * r * r.transpose() - Eigen::Matrix3d::Identity());
  }

  const std::vector<ProbeReading>& readings_;
  int coils_;
};

}  // namespace

DipoleFit fit_dipoles(const CoilField& start, const std::vector<ProbeReading>& readings) {
  const int coils = start.coils();
  check_readings(readings, coils, static_cast<std::size_t>(2 * coils + 1));
  Parameters x;
  for (const Dipole& dipole : start.dipoles()) {
    x.insert(x.end(), dipole.position.begin(), dipole.position.end());
    for (const double m : dipole.moment_per_ampere) x.push_back(m / kMomentUnit);
  }
  x.resize(x.size() + 3, 0);
  ceres::Problem problem;
  problem.AddResidualBlock(new Residuals(readings, coils), nullptr,
                           x.data());  // the problem owns it
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-14;
  options.parameter_tolerance = 1e-12;
  options.gradient_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  const double* background = x.data() + 6 * coils;
  DipoleFit fit{field_of(x.data(), coils),
                kFieldUnit * Eigen::Vector3d(background[0], background[1], background[2])};
  fit.converged = summary.termination_type == ceres::CONVERGENCE;
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
