// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/tail_motion.h"

#include "devices/sim/checks.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo::sim {
namespace {

// Roots of cos(x) cosh(x) = -1: the clamped and free beam's.
constexpr std::array kBeamRoots = {1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349};

// A mode at `part` of the length, its mean square being 1, and its slope times the length.
struct BeamMode {
  double value, slope;
};
BeamMode beam_mode(int k, double part) {
  const double root = kBeamRoots[static_cast<std::size_t>(k)], x = root * part;
  const double share = (std::sinh(root) - std::sin(root)) / (std::cosh(root) + std::cos(root));
  return {std::cosh(x) - std::cos(x) - share * (std::sinh(x) - std::sin(x)),
          root * (std::sinh(x) + std::sin(x) - share * (std::cosh(x) - std::cos(x)))};
}

}  // namespace

TailMotion::TailMotion(const control::FlexibleTail& tail, double viscosity, double moment)
    : tail_(tail), drag_(control::tail_drag(tail, viscosity)), moment_(moment) {
  require_positive(moment, "the moment of the tail's head");
  assemble();
  straighten();
}

// With V the velocity of the body's position, n' that of its axis n and q the modes, all across the
// axis, a point at x along the filament moves by u = V + l n' + sum q_k' phi_k, l = b - a - x its
// place along the axis. The dissipation zeta_n / 2 int u^2 dx and that of the head give the matrix
// R in R [V; n'; q'] = [F; T; -A beta^4 / L^3 q], T the torque as the force that turns the axis.
void TailMotion::assemble() {
  constexpr int kPieces = 2000;
  resistance_.setZero();
  slopes_.setZero();
  areas_.setZero();
  const double b = tail_.head_lever(), L = tail_.length, dx = L / kPieces;
  for (int piece = 0; piece < kPieces; ++piece) {
    const double part = (piece + 0.5) / kPieces;
    Eigen::Matrix<double, kUnknowns, 1> moved;
    Eigen::Matrix<double, kModes, 1> slope;
    moved[0] = 1;
    moved[1] = b - tail_.head_radius - part * L;
    for (int k = 0; k < kModes; ++k) {
      const BeamMode mode = beam_mode(k, part);
      moved[2 + k] = mode.value;
      slope[k] = mode.slope / L;
    }
    resistance_ += drag_.normal * dx * moved * moved.transpose();
    slopes_ += dx * moved * slope.transpose();
    areas_ += dx * moved.tail<kModes>();
  }
  Eigen::Matrix<double, kUnknowns, 1> head = Eigen::Matrix<double, kUnknowns, 1>::Zero();
  head[0] = 1;
  head[1] = b;
  resistance_ += drag_.head * head * head.transpose();
  resistance_(1, 1) += drag_.head_spin;
  for (int k = 0; k < kModes; ++k)
    stiffness_[k] =
        tail_.stiffness() * std::pow(kBeamRoots[static_cast<std::size_t>(k)], 4) / (L * L * L);
}

void TailMotion::straighten() { modes_.setZero(); }

// The rates in the middle of a step of twice `half` s (implicit midpoint rule, stable however stiff
// the filament is): its bending, and the part of the torque that grows with the angle, are taken
// there.
TailMotion::Rates TailMotion::rates(const BodyState& body, const Eigen::Vector3d& field,
                                    const Eigen::Vector3d& force, double half) const {
  const Eigen::Vector3d& n = body.axis;
  const auto across = [&](const Eigen::Vector3d& v) -> Eigen::Vector3d { return v - v.dot(n) * n; };
  const Eigen::Vector3d pushed = across(force);
  Rates loads;
  loads.row(0) = pushed;
  // m n' B is the power of the torque m n x B; the weight acts on the head.
  loads.row(1) = moment_ * across(field) + tail_.head_lever() * pushed;
  loads.bottomRows<kModes>() = -(stiffness_.asDiagonal() * modes_);
  Square matrix = resistance_;
  matrix(1, 1) += half * moment_ * std::max(0.0, field.dot(n));
  matrix.diagonal().tail<kModes>() += half * stiffness_;
  return matrix.llt().solve(loads);
}

// N, along the axis, to the second order of slopes. A piece of tangent t, slope h', feels
// -zeta_n u - (zeta_t - zeta_n) (u.t) t; along the axis that is (zeta_n - zeta_t) u.h' against it,
// so that a wave which runs to the free end pushes forwards; and the bent filament's own way along
// the axis as it turns, -n'.h, with zeta_t.
double TailMotion::thrust(const Rates& rates, const Eigen::Matrix<double, kModes, 3>& modes) const {
  const double slid = (rates.transpose() * slopes_ * modes).trace();
  const double carried = rates.row(1).dot(areas_.transpose() * modes);
  return drag_.tangential * carried - (drag_.normal - drag_.tangential) * slid;
}

// Parts of the step in which the axis turns by little: the torque is linear within each.
TailMotion::Step TailMotion::turn(BodyState& body, const Eigen::Vector3d& field,
                                  const Eigen::Vector3d& force, double span) {
  constexpr double kPart = 0.1;  // rad
  const double fastest = moment_ * field.norm() / drag_.turning + 1e-9;
  const int parts = std::max(1, static_cast<int>(std::ceil(fastest * span / kPart)));
  const double h = span / parts;
  Step step{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  for (int part = 0; part < parts; ++part) {
    const Rates mean = rates(body, field, force, h / 2);
    const Eigen::Vector3d n = body.axis;
    const Eigen::Vector3d turned = h * n.cross(mean.row(1).transpose());
    const Eigen::Matrix<double, kModes, 3> middle = modes_ + h / 2 * mean.bottomRows<kModes>();
    const double along = thrust(mean, middle) / drag_.along;
    const Eigen::Vector3d pushed = force - force.dot(n) * n;
    const Eigen::AngleAxisd half(turned.norm() / 2, turned.normalized());
    // In the middle of the part the axis has turned by half.
    step.swum += h * (half * (along * n + mean.row(0).transpose() - pushed / drag_.across));
    step.turned += turned;
    modes_ += h * mean.bottomRows<kModes>();
    const Eigen::AngleAxisd whole(turned.norm(), turned.normalized());
    modes_ = (modes_ * whole.toRotationMatrix().transpose()).eval();
    turn_body(body, turned);
  }
  return step;
}

Eigen::Vector3d TailMotion::deflection(double part) const {
  Eigen::Vector3d off = Eigen::Vector3d::Zero();
  for (int k = 0; k < kModes; ++k) off += beam_mode(k, part).value * modes_.row(k).transpose();
  return off;
}

}  // namespace vitreo::sim
