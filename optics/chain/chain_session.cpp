// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_session.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

using Root = Eigen::Matrix<double, 5, 5>;

/// W with W' W = C^-1.
// From the Cholesky factor C = L L', W = L^-1. Refused by name where the tracker gave a covariance
// that has no inverse.
Root inverse_root(const Root& covariance) {
  const Eigen::LLT<Root> factor(covariance);
  detail::require(factor.info() == Eigen::Success, "covariance: must be positive definite");
  return factor.matrixL().solve(Root::Identity());
}

// To first order a rotation vector along the directions across; renormalized, so that twenty
// degrees of pitch are still a unit vector.
Eigen::Vector3d turned_axis(const Eigen::Vector3d& axis, const Eigen::Vector2d& turned) {
  return (axis + directions_across(axis) * turned).normalized();
}

// Five numbers of the ellipse and two of the axis, then what else is known of the place.
Eigen::Index rows_of(const ChainLook& look) {
  Eigen::Index rows = 7;  // ellipse and axis
  if (look.contact_sigma > 0) ++rows;
  for (const double sigma : look.known_sigma)
    if (std::isfinite(sigma)) ++rows;
  return rows;
}

/// Contact and known coordinates, from row 7 on.
void add_knowledge(const ViewingChain& chain, const ChainLook& look,
                   const Eigen::Vector3d& position, bool derivatives, ChainBlock& block) {
  Eigen::Index row = 7;
  if (look.contact_sigma > 0) {
    const Eigen::Vector2d at = position.head<2>();
    block.residuals[row] =
        (position.z() - look.lying_height - nominal_retina(chain, at) - retina_offset(chain, at)) /
        look.contact_sigma;
    if (derivatives) {
      // The retina's slope, by differences: it is 0.3 at 4 mm from the axis, so a landing there
      // ties height and place.
      constexpr double kAside = 1e-6;  // m
      for (int i = 0; i < 2; ++i) {
        const Eigen::Vector2d step = kAside * Eigen::Vector2d::Unit(i);
        const auto z = [&](const Eigen::Vector2d& p) {
          return nominal_retina(chain, p) + retina_offset(chain, p);
        };
        block.by_own(row, i) = -(z(at + step) - z(at - step)) / (2 * kAside) / look.contact_sigma;
      }
      block.by_own(row, 2) = 1 / look.contact_sigma;
      block.by_theta.row(row) = -retina_derivative(chain, at) / look.contact_sigma;
    }
    ++row;
  }
  for (int i = 0; i < 3; ++i) {
    if (!std::isfinite(look.known_sigma[i])) continue;
    block.residuals[row] = (position[i] - look.known[i]) / look.known_sigma[i];
    if (derivatives) block.by_own(row, i) = 1 / look.known_sigma[i];
    ++row;
  }
}

/// On the line of sight of the ellipse's center, where the size fits.
std::optional<Eigen::Vector3d> place_by_size(const ViewingChain& chain,
                                             const SmoothEllipseVector& wanted,
                                             const Eigen::Vector3d& axis) {
  constexpr double kNearest = -1e-3;  // m: a retina may stand deeper than believed
  constexpr double kFarthest = 14e-3;
  constexpr int kHalvings = 16;
  const Eigen::Vector2d center = wanted.head<2>();
  const auto sight = chain.line(center);
  if (!sight) return std::nullopt;
  const auto on_line = [&](double z) -> Eigen::Vector3d {
    Eigen::Vector3d point;
    point << sight->head<2>() + z * sight->tail<2>(), z;
    return point;
  };
  double low = kNearest;
  double high = kFarthest;
  for (int i = 0; i < kHalvings; ++i) {
    // The size grows towards the lens; where the chain shows nothing, it is beyond.
    const double middle = (low + high) / 2;
    const auto shown = shown_ellipse(chain, {on_line(middle), axis, center});
    (shown && (*shown)[2] < wanted[2] ? low : high) = middle;
  }
  return on_line((low + high) / 2);
}

/// Where a landmark of the eye stands when the eye has turned about its retina's center.
Eigen::Vector3d landmark_point(const ViewingChain& chain, const Eigen::Vector2d& place) {
  const auto turned = [&chain](OwnParameter which) {
    const ViewingChain::Own& own = chain.own(which);
    return own.at < 0 ? 0 : own.sigma * chain.theta()[own.at];
  };
  const double x = turned(OwnParameter::eye_rotation_x);
  const double y = turned(OwnParameter::eye_rotation_y);
  const Eigen::Vector3d center(0, 0, chain.nominal().prescription.system.surfaces.front().radius);
  const Eigen::Vector3d in_eye(place.x(), place.y(),
                               nominal_retina(chain, place) + retina_offset(chain, place));
  const Eigen::Matrix3d turn = (Eigen::AngleAxisd(y, Eigen::Vector3d::UnitY()) *
                                Eigen::AngleAxisd(x, Eigen::Vector3d::UnitX()))
                                   .toRotationMatrix();
  return center + turn * (in_eye - center);
}

}  // namespace

std::optional<ChainBlock> block_of(const ViewingChain& chain, const ChainLook& look,
                                   const Eigen::Vector3d& position, const Eigen::Vector2d& turned,
                                   bool derivatives) {
  detail::require_positive(look.seen.axis_sigma, "axis_sigma");
  const RobotPlace place{position, turned_axis(look.axis, turned), look.seen.ellipse.head<2>()};
  const Eigen::Index rows = rows_of(look);
  const Root root = inverse_root(smooth_covariance(look.seen));
  ChainBlock block;
  block.residuals = Eigen::VectorXd::Zero(rows);
  SmoothEllipseVector ellipse;
  if (derivatives) {
    const auto shown = differentiated_ellipse(chain, place);
    if (!shown) return std::nullopt;
    ellipse = shown->ellipse;
    block.by_own = Eigen::MatrixXd::Zero(rows, 5);
    block.by_theta = Eigen::MatrixXd::Zero(rows, chain.size());
    block.by_own.topLeftCorner<5, 3>() = root * shown->by_position;
    // The directions across the turned axis are those across the believed one, to first order.
    // They are as the ellipse counts them, about the turned axis; the unknowns count about the
    // believed one.
    const Eigen::Matrix2d same = shown->across.transpose() * directions_across(look.axis);
    block.by_own.block<5, 2>(0, 3) = root * shown->by_axis * same;
    block.by_theta.topRows<5>() = root * shown->by_theta;
    block.by_own(5, 3) = block.by_own(6, 4) = 1 / look.seen.axis_sigma;
  } else {
    const auto shown = shown_ellipse(chain, place);
    if (!shown) return std::nullopt;
    ellipse = *shown;
  }
  block.residuals.head<5>() = root * (ellipse - smooth_from(look.seen.ellipse));
  // What is common to all looks is the chain's, what is left the look's own.
  const Eigen::Matrix<double, 2, 3> to_own = directions_across(look.axis).transpose();
  const Eigen::Vector2d common = to_own * (chain.turned(look.axis) - look.axis);
  block.residuals.segment<2>(5) = (turned - common) / look.seen.axis_sigma;
  if (derivatives)
    block.by_theta.middleRows<2>(5) =
        -to_own * chain.turned_by_theta(look.axis) / look.seen.axis_sigma;
  add_knowledge(chain, look, position, derivatives, block);
  return block;
}

std::optional<ChainBlock> block_of(const ViewingChain& chain, const ChainLandmark& landmark,
                                   const Eigen::Vector2d& place) {
  detail::require_positive(landmark.sigma_px, "sigma_px");
  detail::require_positive(landmark.place_sigma, "place_sigma");
  const Eigen::Vector3d point = landmark_point(chain, place);
  const auto seen = chain.seen(point, landmark.pixel_px);
  if (!seen) return std::nullopt;
  ChainBlock block;
  block.residuals.resize(4);
  // Two rows by the picture of now, two by the picture of the fundus.
  block.residuals << (seen->pixel_px - landmark.pixel_px) / landmark.sigma_px,
      (place - landmark.place) / landmark.place_sigma;
  constexpr double kAside = 1e-6;  // m
  block.by_own = Eigen::MatrixXd::Zero(4, 2);
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d step = kAside * Eigen::Vector2d::Unit(i);
    const Eigen::Vector3d moved =
        (landmark_point(chain, place + step) - landmark_point(chain, place - step)) / (2 * kAside);
    block.by_own.col(i).head<2>() = seen->by_position * moved / landmark.sigma_px;
    block.by_own(2 + i, i) = 1 / landmark.place_sigma;
  }
  block.by_theta = Eigen::MatrixXd::Zero(4, chain.size());
  block.by_theta.topRows<2>() = seen->by_theta / landmark.sigma_px;
  const Eigen::Vector3d center(0, 0, chain.nominal().prescription.system.surfaces.front().radius);
  const Eigen::RowVectorXd depth = retina_derivative(chain, place);
  const Eigen::Matrix<double, 2, 3> by_point = seen->by_position / landmark.sigma_px;
  // A point of the retina moves with its depth and with the eye; the lenses' part is in seen().
  block.by_theta.topRows<2>() += by_point.col(2) * depth;
  const auto turn = [&](OwnParameter which, const Eigen::Vector3d& about) {
    const ViewingChain::Own& own = chain.own(which);
    if (own.at >= 0)
      block.by_theta.col(own.at).head<2>() += by_point * own.sigma * about.cross(point - center);
  };
  turn(OwnParameter::eye_rotation_x, Eigen::Vector3d::UnitX());
  turn(OwnParameter::eye_rotation_y, Eigen::Vector3d::UnitY());
  return block;
}

// theta counts in sigmas, the number in the parameter's own unit.
ChainBlock block_of(const ViewingChain& chain, const ChainNumber& number) {
  detail::require_positive(number.sigma, "numbers: sigma");
  const Eigen::Index i = index_of(chain.parameters(), number.parameter);
  const double sigma = chain.parameters()[static_cast<std::size_t>(i)].sigma;
  ChainBlock block;
  block.residuals.resize(1);
  block.residuals[0] = (sigma * chain.theta()[i] - number.off) / number.sigma;
  block.by_own = Eigen::MatrixXd::Zero(1, 0);
  block.by_theta = Eigen::MatrixXd::Zero(1, chain.size());
  block.by_theta(0, i) = sigma / number.sigma;
  return block;
}

Eigen::MatrixXd information_of(const ChainBlock& block) {
  // Without unknowns of its own a block says all it has.
  Eigen::MatrixXd information = block.by_theta.transpose() * block.by_theta;
  if (block.by_own.cols() == 0) return information;
  const Eigen::MatrixXd cross = block.by_own.transpose() * block.by_theta;
  // In m and rad the scales differ: by a factor of 1e3 of the decomposition's 1e16.
  const Eigen::MatrixXd own = block.by_own.transpose() * block.by_own;
  information -= cross.transpose() * own.ldlt().solve(cross);
  return information;
}

/// Gauss-Newton on the place alone; a step is halved while it does not lower the cost.
std::optional<Eigen::Vector3d> locate_in_chain(const ViewingChain& chain, const OutlineSeen& seen,
                                               const Eigen::Vector3d& believed_axis,
                                               const std::optional<Eigen::Vector3d>& start) {
  const Eigen::Vector3d axis = chain.turned(believed_axis);
  const Eigen::Vector2d center = seen.ellipse.head<2>();
  const SmoothEllipseVector wanted = smooth_from(seen.ellipse);
  const auto begin = start ? start : place_by_size(chain, wanted, axis);
  if (!begin) return std::nullopt;
  Eigen::Vector3d position = *begin;
  const Root outline = smooth_covariance(seen);
  const double axis_variance = seen.axis_sigma * seen.axis_sigma;
  for (int step = 0; step < 20; ++step) {
    const auto shown = differentiated_ellipse(chain, {position, axis, center});
    if (!shown) return std::nullopt;
    // Weighed by what outline and axis together leave uncertain of the ellipse.
    const Root root =
        inverse_root(outline + axis_variance * shown->by_axis * shown->by_axis.transpose());
    const SmoothEllipseVector residual = root * (shown->ellipse - wanted);
    const Eigen::Matrix<double, 5, 3> jacobian = root * shown->by_position;
    Eigen::Vector3d move =
        -(jacobian.transpose() * jacobian).ldlt().solve(jacobian.transpose() * residual);
    if (!move.allFinite()) return std::nullopt;
    // Near the retina's rim the projection bends; a whole step may leave it.
    for (int halving = 0; halving < 10; ++halving, move /= 2) {
      const auto there = shown_ellipse(chain, {position + move, axis, center});
      if (there && (root * (*there - wanted)).squaredNorm() <= residual.squaredNorm() + 1e-9) break;
    }
    position += move;
    if (move.norm() < 1e-8) return position;
  }
  return position;
}

}  // namespace vitreo::optics
