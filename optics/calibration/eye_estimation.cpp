// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/eye_estimation.h"

#include "optics/system/first_order.h"

#include <Eigen/Cholesky>
#include <ceres/ceres.h>

#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

/// The eye whose parameters are off by `x`, in sigmas of their priors.
/// All parameters in units of their priors: the solver's variables are of one size, and x = 0 is
/// the prescription.
Prescription eye_at(const Prescription& prescription, const std::vector<Uncertainty>& priors,
                    const double* x) {
  std::vector<Override> changes;
  for (std::size_t i = 0; i < priors.size(); ++i) {
    changes.emplace_back(priors[i].parameter, parameter(prescription, priors[i].parameter) *
                                                  (1 + priors[i].relative * x[i]));
  }
  return with_parameters(prescription, changes);
}

/// Maximum a posteriori with Gaussian errors: (predicted - measured) / sigma, and x itself for the
/// prior, as x is in sigmas of it.
struct Residuals {
  const Prescription& prescription;
  const std::vector<Uncertainty>& priors;
  const EyeModel& model;
  const Eigen::VectorXd& measured;
  const Eigen::VectorXd& sigmas;

  bool operator()(const double* const* x, double* residuals) const {
    Eigen::VectorXd predicted;
    try {
      predicted = model(eye_at(prescription, priors, x[0]).system);
    } catch (const std::invalid_argument&) {
      return false;  // a step too far: this is no eye
    }
    if (predicted.size() != measured.size() || !predicted.allFinite()) return false;
    Eigen::Map<Eigen::VectorXd>(residuals, measured.size()) =
        (predicted - measured).cwiseQuotient(sigmas);
    for (std::size_t i = 0; i < priors.size(); ++i)
      residuals[static_cast<std::size_t>(measured.size()) + i] = x[0][i];
    return true;
  }
};

/// A relative prior needs a value that is neither zero nor infinite.
/// Found here, a bad argument is named; inside the solver it would only look like no convergence.
void check(const Prescription& prescription, const std::vector<Uncertainty>& priors,
           const Eigen::VectorXd& measured, const Eigen::VectorXd& sigmas) {
  prescription.check();
  if (priors.empty()) throw std::invalid_argument("priors: nothing to estimate");
  for (const Uncertainty& prior : priors) {
    if (!(prior.relative > 0 && prior.relative < 1)) {
      throw std::invalid_argument("priors: " + prior.parameter +
                                  " needs an uncertainty between 0 and 1");
    }
    const double value = parameter(prescription, prior.parameter);
    if (value == 0 || !std::isfinite(value)) {
      throw std::invalid_argument("priors: " + prior.parameter +
                                  " is zero or infinite; no fraction of it is uncertain");
    }
  }
  if (measured.size() == 0 || !measured.allFinite())
    throw std::invalid_argument("measured: must be finite numbers");
  if (sigmas.size() != measured.size() || !(sigmas.array() > 0).all() || !sigmas.allFinite()) {
    throw std::invalid_argument("sigmas: one for each measurement, positive");
  }
}

/// Covariance of x, (J^T J)^-1 at the solution, in units of the priors: J^T J has the prior's
/// identity in it, so it is never singular.
Eigen::MatrixXd covariance(ceres::CostFunction& cost, const std::vector<double>& x, int residuals) {
  const auto n = static_cast<Eigen::Index>(x.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian(residuals, n);
  Eigen::VectorXd values(residuals);
  const double* parameters = x.data();
  double* rows = jacobian.data();
  if (!cost.Evaluate(&parameters, values.data(), &rows))
    throw std::invalid_argument("measured: no derivatives there");
  return (jacobian.transpose() * jacobian).llt().solve(Eigen::MatrixXd::Identity(n, n));
}

/// The share learned is 1 - (sigma / prior sigma)^2 = 1 - C_kk, in units of the prior.
/// Correlations are C_ij / sqrt(C_ii C_jj); those near 1 show parameters that the measurements know
/// as a sum only.
EyeEstimate report(const Prescription& prescription, const std::vector<Uncertainty>& priors,
                   const std::vector<double>& x, const Eigen::MatrixXd& covariance) {
  EyeEstimate estimate{eye_at(prescription, priors, x.data()), {}, covariance, 0, 0};
  for (std::size_t i = 0; i < priors.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const double prior =
        std::abs(parameter(prescription, priors[i].parameter)) * priors[i].relative;
    estimate.parameters.push_back(
        {priors[i].parameter, parameter(estimate.eye, priors[i].parameter),
         prior * std::sqrt(covariance(k, k)), prior, 1 - covariance(k, k)});
  }
  const Eigen::VectorXd scale = covariance.diagonal().cwiseSqrt().cwiseInverse();
  estimate.correlation = scale.asDiagonal() * covariance * scale.asDiagonal();
  return estimate;
}

}  // namespace

/// First-order image distances (4.2) to (4.9).
/// An empty vector where one image is at infinity, which is no eye that the measurements can be of.
EyeModel on_axis_model(std::vector<double> depths) {
  return [depths = std::move(depths)](const System& system) {
    Eigen::VectorXd distances(static_cast<Eigen::Index>(depths.size()));
    for (std::size_t i = 0; i < depths.size(); ++i) {
      const auto image = axial_image(system, depths[i]);
      if (!image) return Eigen::VectorXd();
      distances[static_cast<Eigen::Index>(i)] = image->distance;
    }
    return distances;
  };
}

/// Levenberg-Marquardt (Ceres' default) with central differences, since a model may trace rays.
/// From the prescription as the start. An estimate that did not converge would look like any other,
/// so it throws. chi2 is that of the measurements alone, so that it can be compared with their
/// number.
EyeEstimate estimate_eye(const Prescription& prescription, const std::vector<Uncertainty>& priors,
                         const EyeModel& model, const Eigen::VectorXd& measured,
                         const Eigen::VectorXd& sigmas) {
  check(prescription, priors, measured, sigmas);
  if (model(prescription.system).size() != measured.size()) {
    throw std::invalid_argument(
        "measured: are not as many as the model gives for the prescription");
  }
  const int residuals = static_cast<int>(measured.size()) + static_cast<int>(priors.size());
  // Ceres owns both
  auto* cost = new ceres::DynamicNumericDiffCostFunction<Residuals, ceres::CENTRAL>(
      new Residuals{prescription, priors, model, measured, sigmas});
  cost->AddParameterBlock(static_cast<int>(priors.size()));
  cost->SetNumResiduals(residuals);
  std::vector<double> x(priors.size(), 0.0);
  ceres::Problem problem;
  problem.AddResidualBlock(cost, nullptr, x.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-12;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (summary.termination_type != ceres::CONVERGENCE) {
    throw std::invalid_argument(
        "measured: no eye near the prescription explains it (the solver does not converge)");
  }
  EyeEstimate estimate = report(prescription, priors, x, covariance(*cost, x, residuals));
  double of_prior = 0;
  for (double one : x) of_prior += one * one;
  // Ceres' cost is half the sum of squares, the prior's included.
  estimate.chi2 = 2 * summary.final_cost - of_prior;
  estimate.iterations = static_cast<int>(summary.iterations.size());
  return estimate;
}

}  // namespace vitreo::optics
