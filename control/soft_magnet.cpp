// SPDX-License-Identifier: Apache-2.0
#include "control/soft_magnet.h"

#include "control/constants.h"
#include "control/preconditions.h"

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

// Carlson's elliptic integral
//   R_D(x, y, z) = 3/2 int_0^inf dt / (sqrt(t + x) sqrt(t + y) sqrt(t + z)^3)
// by his duplication theorem (Carlson 1979): each pass brings the arguments four times closer to
// each other, and a fifth-order Taylor series about their mean ends it. Its error is of the sixth
// order in what is left: 1e-3 leaves less than rounding.
double carlson_rd(double x, double y, double z) {
  double sum = 0;
  double factor = 1;
  double ex = 1;
  double ey = 1;
  double ez = 1;
  double mean = 0;
  for (int k = 0; k < 60; ++k) {
    mean = (x + y + 3 * z) / 5;
    ex = (mean - x) / mean, ey = (mean - y) / mean, ez = (mean - z) / mean;
    if (std::max({std::abs(ex), std::abs(ey), std::abs(ez)}) < 1e-3) break;
    const double sx = std::sqrt(x);
    const double sy = std::sqrt(y);
    const double sz = std::sqrt(z);
    const double lambda = sx * (sy + sz) + sy * sz;
    sum += factor / (sz * (z + lambda));
    factor /= 4;
    x = (x + lambda) / 4, y = (y + lambda) / 4, z = (z + lambda) / 4;
  }
  const double ea = ex * ey;
  const double eb = ez * ez;
  const double ec = ea - eb;
  const double ed = ea - 6 * eb;
  const double ef = ed + ec + ec;
  const double series = 1 + ed * (-3. / 14 + 9. / 88 * ed - 4.5 / 26 * ez * ef) +
                        ez * (1. / 6 * ef + ez * (-9. / 22 * ec + 3. / 26 * ez * ea));
  return 3 * sum + factor * series / (mean * std::sqrt(mean));
}

}  // namespace

// N_a = (abc/3) R_D(b^2, c^2, a^2) and cyclic (Osborn 1945 in Carlson's form; facts/magnetics 2).
// Only the ratios of the axes matter: scaled to the largest, nothing underflows.
// Their sum is 1. Throws std::invalid_argument for an axis that is not positive.
Eigen::Vector3d demagnetizing_factors(const Eigen::Vector3d& semi_axes) {
  require(semi_axes.allFinite() && semi_axes.minCoeff() > 0, "semi_axes: must be above 0 m");
  const Eigen::Vector3d s = semi_axes / semi_axes.maxCoeff();
  const Eigen::Vector3d q = s.cwiseProduct(s);
  const double product = s.prod() / 3;
  return {product * carlson_rd(q[1], q[2], q[0]), product * carlson_rd(q[2], q[0], q[1]),
          product * carlson_rd(q[0], q[1], q[2])};
}

void SoftBody::check() const {
  require(std::isfinite(volume) && volume > 0, "soft body volume: must be above 0 m^3");
  require(std::isfinite(saturation) && saturation > 0, "soft body saturation: must be above 0 A/m");
  require(factors.allFinite() && factors.minCoeff() > 0 && factors.maxCoeff() < 1,
          "soft body factors: must be within 0 and 1");
}

// Abbott et al. 2007 (facts/magnetics 2): the susceptibility is far above 1, so the field inside is
// about zero below saturation, H = N M. Above, the energy mu0/2 M.N M - mu0 M.H is least on the
// sphere |M| = Ms, with the torque that follows, at most 1/2 mu0 V |N_r - N_a| Ms^2.
// In the body's axes, A m^2. Continuous at saturation, where both branches have |M| = Ms.
Eigen::Vector3d soft_moment(const SoftBody& body, const Eigen::Vector3d& field_in_body) {
  body.check();
  require(field_in_body.allFinite(), "field_in_body: not finite");
  const Eigen::Vector3d h = field_in_body / kMu0;
  const Eigen::Vector3d linear = h.cwiseQuotient(body.factors);
  if (linear.norm() <= body.saturation) return body.volume * linear;
  // Lagrange's condition on the sphere is (N + x) M = H with one multiplier x > 0 at the minimum,
  // and |M(x)| = Ms is the secular equation of a trust region (More & Sorensen 1983): Newton on
  // 1/|M|, which is nearly straight in x and bends down, so that it comes from below and never
  // beyond.
  double x = 0;
  for (int k = 0; k < 50; ++k) {
    const Eigen::Vector3d denominator = body.factors.array() + x;
    const Eigen::Vector3d m = h.cwiseQuotient(denominator);
    const double size = m.norm();
    const double slope = m.cwiseProduct(m).cwiseQuotient(denominator).sum() / (size * size * size);
    const double step = (1 / body.saturation - 1 / size) / slope;
    x += step;
    if (std::abs(step) <= 1e-14 * (1 + x)) break;
  }
  return body.volume * h.cwiseQuotient(Eigen::Vector3d(body.factors.array() + x));
}

}  // namespace vitreo::control
