// Estimation of the parameters of one eye from measurements through it, with what the measurements
// determine of them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/tolerance.h"

#include <Eigen/Core>

#include <functional>
#include <string>
#include <vector>

namespace vitreo::optics {

/// Predicted measurements through a system, in a fixed order. An empty vector where there is no
/// answer.
using EyeModel = std::function<Eigen::VectorXd(const System&)>;

/// Image distances (m, from the last vertex) of objects on the axis, `depths` (m) before the
/// retina: first order.
EyeModel on_axis_model(std::vector<double> depths);

struct EstimatedParameter {
  std::string name;
  double value = 0;        // SI
  double sigma = 0;        // one sigma after the measurements
  double prior_sigma = 0;  // and before
  // 1 - (sigma / prior_sigma)^2: 0: the data do not constrain it; 1: they determine it alone
  double learned = 0;
};

struct EyeEstimate {
  Prescription eye;
  std::vector<EstimatedParameter> parameters;
  Eigen::MatrixXd correlation;  // of the parameters, after the measurements
  double chi2 = 0;              // of the measurements alone
  int iterations = 0;
};

/// The most probable eye: least squares (Ceres) of the measurements, each with its own sigma,
/// together with what was known before, `priors`, about the prescription's values. Few measurements
/// determine few combinations of parameters; the prior keeps the rest where they were, and
/// `learned` tells them apart. Throws std::invalid_argument naming a bad argument, or `measured`
/// when the solver does not converge.
EyeEstimate estimate_eye(const Prescription& prescription, const std::vector<Uncertainty>& priors,
                         const EyeModel& model, const Eigen::VectorXd& measured,
                         const Eigen::VectorXd& sigmas);

}  // namespace vitreo::optics
