// Least squares over position, rotation and size of a body; covariance of the result and the
// directions that are not observed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <functional>
#include <optional>
#include <vector>

namespace vitreo::optics::detail {

struct BodyState {
  Eigen::Vector3d position{0, 0, 0};                          // m, eye frame
  Eigen::Matrix3d orientation = Eigen::Matrix3d::Identity();  // eye_from_body
  double scale = 1;                                           // of the body's size
};

/// Which parameters are free: 0 to 2 position, 3 to 5 rotation about the body's axes, 6 the
/// logarithm of the size.
using FreeParameters = std::vector<int>;
/// The state moved by steps of the free parameters (m, rad, 1). Rotations act in the body's frame,
/// by the exponential.
BodyState moved(const BodyState& state, const FreeParameters& free, const Eigen::VectorXd& step);

/// Residuals of unit variance; nothing where the state has no image. With `per_state`, their
/// derivatives by all seven parameters go there (rows x 7) where they are known; it stays empty
/// where they are to be had by differences.
using BodyResiduals = std::function<std::optional<Eigen::VectorXd>(const BodyState& state,
                                                                   Eigen::MatrixXd* per_state)>;

struct Minimum {
  BodyState state;
  Eigen::VectorXd residuals;
  Eigen::MatrixXd jacobian;  // by the free parameters
  double cost = 0;           // sum of squares
  int iterations = 0;
  bool converged = false;
};

/// Levenberg-Marquardt, with central differences where derivatives are not given. Where the cost
/// has a kink it is followed to its lowest place, unless `roughly`, and the Jacobian is that of one
/// side. Nothing when the start has no image.
std::optional<Minimum> minimize(const BodyResiduals& residuals, const FreeParameters& free,
                                const BodyState& start, bool roughly = false);

/// Of the free parameters, by the information J^T J. A direction whose sigma is above a unit (3 mm,
/// 0.4 rad, 20 % of size) is not observed. Parameters that such a direction moves by more than 2 %
/// of a unit have an infinite variance and no covariances; to the variance of others it adds what 2
/// pi / 0.4 units along it move them by: a whole turn.
struct Observed {
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd unobservable;  // columns: unit directions in those units
};
/// `widen` is asked for a direction's true sigma when the one by the Jacobian is weak, above a
/// tenth of a unit.
using Widen = std::function<double(const Eigen::VectorXd& direction, double sigma)>;
Observed observed_from(const Eigen::MatrixXd& jacobian, const FreeParameters& free,
                       const Widen& widen);

/// The free parameters' natural units, above.
Eigen::VectorXd parameter_units(const FreeParameters& free);

}  // namespace vitreo::optics::detail
