// One dense residual block with its own derivatives: the field's gradient is that by the dipole's place, negative.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_fit.h"

#include <Eigen/QR>
#include <ceres/cost_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::control {
namespace {

constexpr double kMu0Over4Pi = 1e-7;     // T m/A
constexpr double kMomentUnit = 100;      // A m^2/A: brings moments to the size of positions in m
constexpr double kFieldUnit = 1e-3;      // T: residuals of about one
using Parameters = std::vector<double>;  // per coil position (m) and moment (kMomentUnit), then background (kFieldUnit)
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

CoilField field_of(const double* x, int coils) {
  std::vector<Dipole> dipoles;
  for (int k = 0; k < coils; ++k, x += 6) {
    dipoles.push_back({Eigen::Vector3d(x[0], x[1], x[2]), kMomentUnit * Eigen::Vector3d(x[3], x[4], x[5])});
  }
  return CoilField(std::move(dipoles));
}

class Residuals final : public ceres::CostFunction {
 public:
  Residuals(const std::vector<ProbeReading>& readings, int coils) : readings_(readings), coils_(coils) {
    set_num_residuals(static_cast<int>(3 * readings.size()));
    mutable_parameter_block_sizes()->push_back(6 * coils + 3);
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const double* x = parameters[0];
    const int unknowns = 6 * coils_ + 3;
    for (int i = 0; i < unknowns; ++i) {
      if (!std::isfinite(x[i])) return false;
    }
    const CoilField field = field_of(x, coils_);
    const Eigen::Map<const Eigen::Vector3d> background(x + 6 * coils_);
    Eigen::Map<RowMajor> jacobian(jacobians ? jacobians[0] : nullptr, jacobians ? num_residuals() : 0, unknowns);
    for (std::size_t n = 0; n < readings_.size(); ++n) {
      const ProbeReading& reading = readings_[n];
      const FieldMatrix matrix = field.matrix(reading.position);
      const Eigen::Vector3d model = matrix.topRows<3>() * reading.currents;
      Eigen::Map<Eigen::Vector3d>(residuals + 3 * n) = (model - reading.field) / kFieldUnit + background;
      if (!jacobians || !jacobians[0]) continue;
      const auto row = static_cast<Eigen::Index>(3 * n);
      for (int k = 0; k < coils_; ++k) {
        const double current = reading.currents[k] / kFieldUnit;
        jacobian.block<3, 3>(row, 6 * k) = -current * gradient_matrix(matrix.col(k));
        jacobian.block<3, 3>(row, 6 * k + 3) =
            current * kMomentUnit * by_moment(reading.position - field.dipoles()[static_cast<std::size_t>(k)].position);
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

void check(const CoilField& start, const std::vector<ProbeReading>& readings) {
  const int coils = start.coils();
  Eigen::MatrixXd currents(static_cast<Eigen::Index>(readings.size()), coils + 1);
  for (std::size_t n = 0; n < readings.size(); ++n) {
    const ProbeReading& reading = readings[n];
    const std::string name = "reading " + std::to_string(n);
    if (!reading.position.allFinite()) throw std::invalid_argument(name + ": position is not finite");
    if (!reading.field.allFinite()) throw std::invalid_argument(name + ": field is not finite");
    if (reading.currents.size() != coils) throw std::invalid_argument(name + ": one current a coil is needed");
    if (!reading.currents.allFinite()) throw std::invalid_argument(name + ": a current is not finite");
    currents.row(static_cast<Eigen::Index>(n)) << reading.currents.transpose(), 1;
  }
  if (readings.size() < static_cast<std::size_t>(2 * coils + 1)) {
    throw std::invalid_argument("readings: " + std::to_string(readings.size()) + " given, at least " +
                                std::to_string(2 * coils + 1) + " needed");
  }
  for (int k = 0; k < coils; ++k) {
    if (!(currents.col(k).norm() > 0)) {
      throw std::invalid_argument("readings: coil " + std::to_string(k) + " never had a current");
    }
    currents.col(k) /= currents.col(k).norm();
  }
  currents.col(coils).normalize();
  if (Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(currents).setThreshold(1e-6).rank() <= coils) {
    throw std::invalid_argument("readings: the currents never vary independently");
  }
}

void report(DipoleFit& fit, const std::vector<ProbeReading>& readings) {
  double misses = 0, size = 0;
  for (std::size_t n = 0; n < readings.size(); ++n) {
    const ProbeReading& reading = readings[n];
    const Eigen::Vector3d made = fit.field.matrix(reading.position).topRows<3>() * reading.currents;
    const double miss = (made + fit.background - reading.field).norm();
    misses += miss * miss;
    size += reading.field.squaredNorm();
    if (miss > fit.residual_largest) fit.residual_largest = miss, fit.worst_reading = n;
  }
  fit.residual_rms = std::sqrt(misses / (3 * static_cast<double>(readings.size())));
  fit.residual_relative = size > 0 ? std::sqrt(misses / size) : 0;
}

}  // namespace

DipoleFit fit_dipoles(const CoilField& start, const std::vector<ProbeReading>& readings) {
  check(start, readings);
  const int coils = start.coils();
  Parameters x;
  for (const Dipole& dipole : start.dipoles()) {
    x.insert(x.end(), dipole.position.begin(), dipole.position.end());
    for (const double m : dipole.moment_per_ampere) x.push_back(m / kMomentUnit);
  }
  x.resize(x.size() + 3, 0);
  ceres::Problem problem;
  problem.AddResidualBlock(new Residuals(readings, coils), nullptr, x.data());  // the problem owns it
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
  DipoleFit fit{field_of(x.data(), coils), kFieldUnit * Eigen::Vector3d(background[0], background[1], background[2])};
  fit.converged = summary.termination_type == ceres::CONVERGENCE;
  report(fit, readings);
  return fit;
}

}  // namespace vitreo::control
