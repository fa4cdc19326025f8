// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_doubt.h"

#include "optics/numerics/preconditions.h"
#include "optics/pose/ellipse_weight.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

using Five = Eigen::Matrix<double, 5, 5>;
using Gain = Eigen::Matrix<double, 3, 5>;

/// Variance of what was not measured, px^2: no weight is left to it.
constexpr double kUnmeasured = 1e8;

/// (5.15) in smooth coordinates. The squares of both axes' errors are twice those of mean and half
/// difference; along the ellipse d((a - b) / 2) counts so, across it (a - b) dphi counts by half
/// the angle's weight, squared.
Five thesis_information(const EllipseVector& ellipse) {
  constexpr double kAngleWeight = 0.1;
  const double cosine = std::cos(2 * ellipse[4]);
  const double sine = std::sin(2 * ellipse[4]);
  Eigen::Matrix2d turn;
  turn << cosine, sine, -sine, cosine;
  const Eigen::Matrix2d both = Eigen::Vector2d(2, kAngleWeight * kAngleWeight / 4).asDiagonal();
  Five weights = Five::Zero();
  weights.diagonal() << 1, 1, 2, 0, 0;
  weights.bottomRightCorner<2, 2>() = turn.transpose() * both * turn;
  return weights;
}

/// (J' W J)^-1 J' W; nothing when a direction is not observed.
// Directions are compared by their information: 1e-10 of the best is no measurement but rounding.
std::optional<Gain> gain_of(const Eigen::Matrix<double, 5, 3>& jacobian, const Five& weights) {
  constexpr double kUnobserved = 1e-10;
  const Eigen::Matrix3d information = jacobian.transpose() * weights * jacobian;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spectrum(information);
  if (!(spectrum.eigenvalues()[0] > kUnobserved * spectrum.eigenvalues()[2])) return std::nullopt;
  return Gain(information.inverse() * jacobian.transpose() * weights);
}

/// What one ellipse says of a position, to first order.
struct Linearized {
  ShownEllipse shown;
  Five noise;  // of outline and axis, smooth coordinates
  Gain gain;
};

std::optional<Linearized> linearize(const ViewingChain& chain, const RobotPlace& place,
                                    const OutlineSeen& seen, PositionFit fit) {
  RobotPlace turned = place;
  turned.axis = chain.turned(place.axis);
  auto shown = differentiated_ellipse(chain, turned);
  if (!shown) return std::nullopt;
  shown->by_theta +=
      shown->by_axis * (shown->across.transpose() * chain.turned_by_theta(place.axis));
  Linearized made{std::move(*shown), smooth_covariance(seen), {}};
  made.noise +=
      seen.axis_sigma * seen.axis_sigma * made.shown.by_axis * made.shown.by_axis.transpose();
  const Five weights =
      fit == PositionFit::thesis ? thesis_information(seen.ellipse) : Five(made.noise.inverse());
  const auto gain = gain_of(made.shown.by_position, weights);
  if (!gain) return std::nullopt;
  made.gain = *gain;
  return made;
}

/// The residual's part that no position explains, by its whole covariance: r' S^-1 r less what the
/// best position takes of it.
double unexplained(const Linearized& seen_here, const OutlineSeen& seen, const Five& of_chain) {
  const ShownEllipse& shown = seen_here.shown;
  const Five all = seen_here.noise + of_chain;
  const SmoothEllipseVector residual = smooth_from(seen.ellipse) - shown.ellipse;
  const Eigen::LDLT<Five> factor(all);
  const SmoothEllipseVector weighted = factor.solve(residual);
  const Eigen::Matrix<double, 5, 3> jacobian = factor.solve(shown.by_position);
  const Eigen::Matrix3d information = shown.by_position.transpose() * jacobian;
  const Eigen::Vector3d slope = shown.by_position.transpose() * weighted;
  return std::max(0.0, residual.dot(weighted) - slope.dot(information.ldlt().solve(slope)));
}

}  // namespace

/// Covariance of the smooth coordinates, as ellipse_weight() weighs: an angle that is not known
/// takes the elongation out.
Five smooth_covariance(const OutlineSeen& seen) {
  const detail::EllipseWeight weight = detail::ellipse_weight(seen.ellipse, seen.covariance);
  Five information = weight.root.transpose() * weight.root;
  if (weight.terms < 5) information.bottomRightCorner<2, 2>().diagonal().array() += 1 / kUnmeasured;
  Five covariance = information.inverse();
  // Independent errors of both semi-axes are half as large in their mean and half difference.
  covariance.diagonal().array() += seen.contour_sigma_px * seen.contour_sigma_px / 2;
  return covariance;
}

ChainBelief prior_belief(const NominalChain& nominal, const ChainSigmas& sigmas) {
  auto parameters = chain_parameters(nominal, sigmas);
  const auto count = static_cast<Eigen::Index>(parameters.size());
  return {ViewingChain(nominal, std::move(parameters), Eigen::VectorXd::Zero(count)),
          Eigen::MatrixXd::Identity(count, count)};
}

double nominal_retina(const ViewingChain& chain, const Eigen::Vector2d& at) {
  return chain.nominal().prescription.system.surfaces.front().sag(at.norm());
}

double retina_offset(const ViewingChain& chain, const Eigen::Vector2d& at) {
  const Eigen::Vector2d r = at / detail::kRetinaRadius;
  const auto& shape = chain.placed().retina;
  return shape[0] + shape[1] * r.x() + shape[2] * r.y() + shape[3] * r.squaredNorm() +
         shape[4] * (r.x() * r.x() - r.y() * r.y()) + shape[5] * 2 * r.x() * r.y();
}

Eigen::RowVectorXd retina_derivative(const ViewingChain& chain, const Eigen::Vector2d& at) {
  const Eigen::Vector2d r = at / detail::kRetinaRadius;
  Eigen::RowVectorXd by = Eigen::RowVectorXd::Zero(chain.size());
  chain.add(OwnParameter::retina_depth, 1, by);
  chain.add(OwnParameter::retina_tilt_x, r.x(), by);
  chain.add(OwnParameter::retina_tilt_y, r.y(), by);
  chain.add(OwnParameter::retina_curvature, r.squaredNorm(), by);
  chain.add(OwnParameter::retina_astigmatism_x, r.x() * r.x() - r.y() * r.y(), by);
  chain.add(OwnParameter::retina_astigmatism_y, 2 * r.x() * r.y(), by);
  return by;
}

/// The estimate is P + G (e + J_axis a + J_theta theta): observed less believed, through the
/// estimator's own gain G.
std::optional<PositionDoubt> position_doubt(const ChainBelief& belief, const RobotPlace& place,
                                            const OutlineSeen& seen, PositionFit fit,
                                            const Eigen::Vector2d& touched) {
  detail::require(seen.contour_sigma_px >= 0 && seen.axis_sigma >= 0,
                  "seen: sigmas must not be negative");
  const auto here = linearize(belief.chain, place, seen, fit);
  if (!here) return std::nullopt;
  const Eigen::MatrixXd& C = belief.covariance;
  PositionDoubt doubt;
  doubt.by_theta = here->gain * here->shown.by_theta;
  doubt.noise = here->gain * here->noise * here->gain.transpose();
  // What a filter may average is the tracker's; contour and axis stay for as long as the robot lies
  // as it does.
  OutlineSeen alone = seen;
  alone.contour_sigma_px = 0;
  doubt.tracker = here->gain * smooth_covariance(alone) * here->gain.transpose();
  const auto& J = here->shown.by_theta;
  const Eigen::Index eyes = belief.chain.eye_size();
  const Eigen::Matrix<double, 5, Eigen::Dynamic> with_all = J * C;
  const Five of_chain = with_all * J.transpose();
  const Five of_eye = with_all.leftCols(eyes) * J.leftCols(eyes).transpose();
  const Eigen::Matrix3d chain = here->gain * of_chain * here->gain.transpose();
  doubt.eye = here->gain * ((of_eye + of_eye.transpose()) / 2) * here->gain.transpose();
  doubt.calibration = chain - doubt.eye;
  doubt.covariance = doubt.noise + chain;
  const Eigen::RowVectorXd retina = retina_derivative(belief.chain, touched);
  const Eigen::RowVectorXd height = doubt.by_theta.row(2) + retina;
  const Eigen::RowVectorXd with_height = here->gain.row(2) * with_all + retina * C;
  doubt.height_noise = doubt.noise(2, 2);
  doubt.height_variance = doubt.height_noise + with_height.dot(height);
  doubt.chi2 = unexplained(*here, seen, of_chain);
  return doubt;
}

/// The scale is changed until the look's z is the known one: theta' = theta - e (a theta + r theta
/// + n) / a_pixel with a = d z / d theta at the look, r what the known height shares with the
/// retina, n the noise of both, and e the pixel's own direction. C' = T C T' + e e' var(n) /
/// a_pixel^2.
std::optional<ChainBelief> scale_calibrated(const ChainBelief& before, const ScaleLook& look,
                                            PositionFit fit) {
  detail::require_not_negative(look.known_z_sigma, "known_z_sigma");
  const Eigen::Index pixel = index_of(before.chain.parameters(), "pixel");
  const auto here = linearize(before.chain, look.place, look.seen, fit);
  if (!here) return std::nullopt;
  Eigen::RowVectorXd of_z = here->gain.row(2) * here->shown.by_theta;
  const double by_pixel = of_z[pixel];
  if (!(std::abs(by_pixel) > 1e-9)) return std::nullopt;  // m per sigma
  if (look.on_retina) of_z += retina_derivative(before.chain, look.place.position.head<2>());
  // Only the pixel's row changes: all other parameters are as unknown as before.
  Eigen::MatrixXd through = Eigen::MatrixXd::Identity(before.chain.size(), before.chain.size());
  through.row(pixel) -= of_z / by_pixel;
  const Eigen::RowVector<double, 5> noise = here->gain.row(2);
  const double variance = noise.dot((here->noise * noise.transpose()).transpose()) +
                          look.known_z_sigma * look.known_z_sigma;
  ChainBelief after = before;
  after.covariance = through * before.covariance * through.transpose();
  after.covariance(pixel, pixel) += variance / (by_pixel * by_pixel);
  return after;
}

}  // namespace vitreo::optics
