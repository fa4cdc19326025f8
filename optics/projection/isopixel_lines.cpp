// SPDX-License-Identifier: Apache-2.0
#include "optics/projection/isopixel_lines.h"

#include "optics/numerics/linear.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace vitreo::optics::detail {
namespace {

constexpr double kSlack = 1e-9;  // of max_m: a point computed to lie on the table's edge is in it
constexpr int kMaxSteps = 30;

/// The largest |m| up to max_m to which rays come through, along one radius.
/// Less than max_m is usual, as an image ends where the lens does; less than half of it is taken
/// for a wrong max_m. From the first lost ray on nothing counts, though rays may come through
/// again.
double reach_of(const TraceLine& trace, double max_m) {
  constexpr int kSteps = 64;
  int last = 0;
  while (last < kSteps && trace({max_m * (last + 1) / kSteps, 0})) ++last;
  if (2 * last < kSteps)
    throw std::invalid_argument("max_m: more than half of the rays up to it are lost");
  return max_m * last / kSteps;
}

}  // namespace

/// x = m (A + S z): A and S are even in |m| by symmetry, so they are fitted as polynomials in
/// |m|^2, at Chebyshev nodes of the scaled variable 2 |m|^2 / max_m^2 - 1, by least squares.
/// x / m has no zero on the axis, so dividing costs no digits, and Chebyshev nodes keep the least
/// squares away from Runge's oscillation. Terms that change the line by less than femtometers are
/// dropped at once, as every projection evaluates them.
RadialLines::RadialLines(const TraceLine& trace, double max_m) : max_m_(reach_of(trace, max_m)) {
  constexpr int kSamples = 48;
  Eigen::MatrixXd powers(kSamples, kTerms);
  Eigen::MatrixXd ratios(kSamples, 2);
  for (int i = 0; i < kSamples; ++i) {
    const double x = std::cos(std::numbers::pi * (i + 0.5) / kSamples);
    const double m = max_m_ * std::sqrt((x + 1) / 2);
    const auto traced = trace({m, 0});
    if (!traced) throw std::invalid_argument("max_m: rays within it are lost");
    ratios.row(i) << traced->at_retina.x() / m, traced->slope.x() / m;
    for (int k = 0; k < kTerms; ++k) powers(i, k) = std::pow(x, k);
  }
  const Eigen::MatrixXd fit = least_squares(powers, ratios);
  for (int k = 0; k < kTerms; ++k) a_[k] = fit(k, 0), s_[k] = fit(k, 1);
  constexpr double kNothing = 1e-12;  // of the line's position: femtometers
  const auto matters = [&](int k) {
    return std::abs(a_[k]) > kNothing * std::abs(a_[0]) ||
           std::abs(s_[k]) > kNothing * std::abs(s_[0]);
  };
  terms_ = kTerms;
  while (terms_ > 1 && !matters(terms_ - 1)) --terms_;
}

/// Horner's scheme for both polynomials and their derivatives.
/// The derivative of a Horner step p x + c is p' x + p.
RadialLines::Values RadialLines::values(double m2) const {
  const double per = 2 / (max_m_ * max_m_);
  const double x = m2 * per - 1;
  Values v{0, 0, 0, 0};
  for (int k = terms_ - 1; k >= 0; --k) {
    v.a_per = v.a_per * x + v.a;
    v.s_per = v.s_per * x + v.s;
    v.a = v.a * x + a_[k];
    v.s = v.s * x + s_[k];
  }
  v.a_per *= per;
  v.s_per *= per;
  return v;
}

/// kSlack is relative here.
bool RadialLines::covers(const Eigen::Vector2d& m) const {
  return m.norm() <= max_m_ * (1 + kSlack);
}

IsopixelLine RadialLines::line(const Eigen::Vector2d& m) const {
  return line(m, values(m.squaredNorm()));
}

/// d (m A(|m|^2)) / dm = A I + 2 A' m m^T.
IsopixelLine RadialLines::line(const Eigen::Vector2d& m, const Values& v) {
  const Eigen::Matrix2d outer = 2 * m * m.transpose();
  const Eigen::Matrix2d one = Eigen::Matrix2d::Identity();
  return {v.a * m, v.s * m, v.a * one + v.a_per * outer, v.s * one + v.s_per * outer};
}

/// r^2 = M (A(M) + S(M) z)^2 for M = |m|^2 by Newton's method: smooth on the axis, and nearly
/// linear. Its derivative by M is g (g + 2 M g') with g = A + S z.
/// Unique while the slope is positive; a slope of zero is where neighboring lines cross, and the
/// answer is none.
bool RadialLines::solve(const Eigen::Vector3d& point, Eigen::Vector2d& m,
                        IsopixelLine& line) const {
  constexpr double kConverged = 1e-9;  // of max_m^2; the step after such a step is below rounding
  const double r2 = point.head<2>().squaredNorm();
  const double limit = max_m_ * max_m_;
  double m2 = 0;
  for (int step = 0; step < kMaxSteps; ++step) {
    const Values v = values(m2);
    const double g = v.a + v.s * point.z();
    const double slope = g * (g + 2 * m2 * (v.a_per + v.s_per * point.z()));
    const double move = (r2 - m2 * g * g) / slope;
    if (!(slope > 0 && std::isfinite(move))) return false;
    // The table ends here and Newton's method still leads outwards.
    if (m2 >= limit && move > kSlack * limit) return false;  // it lies further out
    m2 = std::clamp(m2 + move, 0.0, limit);
    if (std::abs(move) < kConverged * limit) {
      const Values found = values(m2);
      m = point.head<2>() / (found.a + found.s * point.z());
      line = RadialLines::line(m, found);
      return true;
    }
  }
  return false;
}

/// Traced at every node of a square grid of m.
/// A node whose ray is lost is a NaN, which each interpolation over it inherits: the table's edge
/// needs no list of its own.
GridLines::GridLines(const TraceLine& trace, double max_m)
    : max_m_(max_m), step_(2 * max_m / (kNodes - 3)) {
  // One node beyond the square on each side, for the cubics of its outermost cells.
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  nodes_.reserve(static_cast<std::size_t>(kNodes) * kNodes);
  for (int j = 0; j < kNodes; ++j) {
    for (int i = 0; i < kNodes; ++i) {
      const auto traced = trace({(i - kMiddle) * step_, (j - kMiddle) * step_});
      nodes_.push_back(traced ? Eigen::Vector4d(traced->at_retina.x(), traced->at_retina.y(),
                                                traced->slope.x(), traced->slope.y())
                              : Eigen::Vector4d::Constant(kNan));
    }
  }
  if (!line({0, 0}).at_retina.allFinite())
    throw std::invalid_argument("max_m: the rays in the middle are lost");
}

/// By evaluation: the edge of a grid with lost nodes is no simple shape.
bool GridLines::covers(const Eigen::Vector2d& m) const {
  return m.cwiseAbs().maxCoeff() <= max_m_ * (1 + kSlack) && line(m).at_retina.allFinite();
}

/// Bicubic Lagrange interpolation through 4 x 4 nodes: w are the weights at the nodes -1, 0, 1, 2
/// for t in [0, 1], d their derivatives. A lost node makes the result a NaN.
/// The cubics share their nodes with those of the neighboring cells, so values are continuous and
/// slopes nearly.
IsopixelLine GridLines::line(const Eigen::Vector2d& m) const {
  double weight[2][4];
  double change[2][4];
  int first[2];
  for (int axis = 0; axis < 2; ++axis) {
    const double index = m[axis] / step_ + kMiddle;
    first[axis] = std::clamp(static_cast<int>(index) - 1, 0, kNodes - 4);
    const double t = index - first[axis] - 1;  // from the second of four nodes; in [0, 1]
    double* w = weight[axis];
    double* d = change[axis];
    w[0] = -t * (t - 1) * (t - 2) / 6;
    w[1] = (t + 1) * (t - 1) * (t - 2) / 2;
    w[2] = -(t + 1) * t * (t - 2) / 2;
    w[3] = (t + 1) * t * (t - 1) / 6;
    d[0] = -(3 * t * t - 6 * t + 2) / 6;
    d[1] = (3 * t * t - 4 * t - 1) / 2;
    d[2] = -(3 * t * t - 2 * t - 2) / 2;
    d[3] = (3 * t * t - 1) / 6;
  }
  Eigen::Vector4d value = Eigen::Vector4d::Zero();
  Eigen::Vector4d per_x = value;
  Eigen::Vector4d per_y = value;
  for (int j = 0; j < 4; ++j) {
    const Eigen::Vector4d* row =
        &nodes_[static_cast<std::size_t>((first[1] + j) * kNodes + first[0])];
    const Eigen::Vector4d across = weight[0][0] * row[0] + weight[0][1] * row[1] +
                                   weight[0][2] * row[2] + weight[0][3] * row[3];
    const Eigen::Vector4d along = change[0][0] * row[0] + change[0][1] * row[1] +
                                  change[0][2] * row[2] + change[0][3] * row[3];
    value += weight[1][j] * across;
    per_x += weight[1][j] * along;
    per_y += change[1][j] * across;
  }
  IsopixelLine made;
  made.at_retina = value.head<2>();
  made.slope = value.tail<2>();
  made.at_retina_per_m << per_x.head<2>() / step_, per_y.head<2>() / step_;
  made.slope_per_m << per_x.tail<2>() / step_, per_y.tail<2>() / step_;
  return made;
}

/// Newton's method in m, the 2 x 2 Jacobian inverted by its adjugate. Steps are clamped to the
/// square, where the table has values.
/// From m = 0, the middle of the image, where the constructor has made sure of a line.
bool GridLines::solve(const Eigen::Vector3d& point, Eigen::Vector2d& m, IsopixelLine& line) const {
  constexpr double kConverged = 1e-10;  // m: the step after such a step is below a nanometer by far
  m.setZero();
  for (int step = 0; step < kMaxSteps; ++step) {
    line = this->line(m);
    const Eigen::Matrix2d per_m = line.per_m(point.z());
    const double determinant = per_m(0, 0) * per_m(1, 1) - per_m(0, 1) * per_m(1, 0);
    const Eigen::Vector2d off = point.head<2>() - line.at(point.z());
    const Eigen::Vector2d move(per_m(1, 1) * off.x() - per_m(0, 1) * off.y(),
                               per_m(0, 0) * off.y() - per_m(1, 0) * off.x());
    if (!(determinant > 0)) return false;  // lost, or where the lines have crossed
    m += move / determinant;
    if (!(m.cwiseAbs().maxCoeff() <= 1.5 * max_m_)) return false;
    if (move.norm() < kConverged * determinant) {
      line = this->line(m);
      return m.cwiseAbs().maxCoeff() <= max_m_ * (1 + kSlack) && line.at_retina.allFinite();
    }
    m = m.cwiseMax(-max_m_).cwiseMin(max_m_);
  }
  return false;
}

}  // namespace vitreo::optics::detail
