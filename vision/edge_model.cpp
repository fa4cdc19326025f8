// SPDX-License-Identifier: Apache-2.0
#include "vision/edge_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::vision {
namespace {

// Range and step of the table's depths, in units of the blur; below, nothing of the body shows.
constexpr double kFirstDepth = -5;
constexpr double kLastDepth = 30;
constexpr double kDepthStep = 1.0 / 16;

// Seven-point Gauss-Hermite quadrature for a standard normal (Abramowitz & Stegun 25.4.46, nodes
// times sqrt 2, weights over sqrt pi): exact to the 13th power.
constexpr std::array<double, 7> kNodes = {
    -3.750439717725742, -2.366759410734541, -1.154405394739968, 0,
    1.154405394739968,  2.366759410734541,  3.750439717725742};
constexpr std::array<double, 7> kNodeWeights = {
    5.482688559722e-4, 3.0757123967586e-2, 0.240123178605013, 0.457142857142857,
    0.240123178605013, 3.0757123967586e-2, 5.482688559722e-4};

// Where n^2 reaches this a specular highlight may begin: a sample there counts half.
constexpr double kTrusted = 0.25;

// Density of the unit Gaussian.
double normal_density(double z) { return std::exp(-z * z / 2) / std::sqrt(2 * std::numbers::pi); }

}  // namespace

// Once per model, by quadrature with steps of 0.01 in x; measurements then interpolate.
EdgeModel::EdgeModel() {
  for (double z = kFirstDepth; z <= kLastDepth + kDepthStep / 2; z += kDepthStep) {
    // A step blurred by a unit Gaussian is the normal distribution Phi(z).
    Entry entry{std::erfc(-z / std::numbers::sqrt2) / 2, 0, 0, 0, normal_density(z)};
    // root(z) = integral of sqrt(y) phi(z - y) over y > 0, with y = x^2 so that nothing is singular
    // at the rim; root1 and root2, its derivatives, by phi'(z - y) = u phi and phi'' = (u^2 - 1)
    // phi, u = y - z.
    const double dx = 0.01;
    for (double x = std::sqrt(std::max(z - 7, 0.0)); x * x < z + 7; x += dx) {
      const double u = x * x - z;
      const double weight = 2 * x * x * normal_density(u) * dx;
      entry.root += weight;
      entry.root1 += u * weight;
      entry.root2 += (u * u - 1) * weight;
    }
    table_.push_back(entry);
  }
}

// Linear interpolation in the table, 16 entries per sigma.
// Beyond the table's ends its last values: far outside nothing shows, far inside the slope hardly
// matters.
EdgeModel::Entry EdgeModel::at(double depth) const {
  const double index =
      std::clamp((depth - kFirstDepth) / kDepthStep, 0.0, static_cast<double>(table_.size() - 2));
  const auto k = static_cast<std::size_t>(index);
  const double f = index - static_cast<double>(k);
  const Entry& a = table_[k];
  const Entry& b = table_[k + 1];
  return {a.step + f * (b.step - a.step), a.root + f * (b.root - a.root),
          a.root1 + f * (b.root1 - a.root1), a.root2 + f * (b.root2 - a.root2),
          a.density + f * (b.density - a.density)};
}

// 1, n and n^2 over the depth y, blurred by a unit Gaussian, at the depth z. On a chord of length 1
// / k (all in units of the blur) n^2 goes as y (1 - k y) and n as its root, sqrt(y) (1 - k y / 2 -
// k^2 y^2 / 8), to second order.
// value, first and second: the blurred shade and its derivatives by depth, in units of the blur.
EdgeModel::Blurred EdgeModel::blurred(double z, double k) const {
  const Entry e = at(z);
  // Blurred powers of the depth M_p = (y^p * phi)(z), each from lower ones: M_(p+1) = z M_p + M_p'
  // and M_p' = p M_(p-1). root3: p = 1.5, root5: p = 2.5.
  const double root3 = z * e.root + e.root1;
  const double root5 = z * root3 + 1.5 * e.root;
  // p = 1 and 2.
  const double ramp = z * e.step + e.density;
  const double square = z * ramp + e.step;
  Blurred b;
  b.value = Eigen::Vector3d(e.step, e.root - k / 2 * root3 - k * k / 8 * root5, ramp - k * square);
  b.first = Eigen::Vector3d(e.density, e.root1 - 0.75 * k * e.root - 0.3125 * k * k * root3,
                            e.step - 2 * k * ramp);
  b.second =
      Eigen::Vector3d(-z * e.density, e.root2 - 0.75 * k * e.root1 - 0.46875 * k * k * e.root,
                      e.density - 2 * k * e.step);
  return b;
}

// The blur along the normal is analytic (blurred()); across it, by quadrature over lines parallel
// to the normal, each cut with the ellipse itself, so that the rim's curvature is in it.
// `a`, `b` semi-axes and `sigma` in px, `t` the parameter of the rim's point; sample j lies
// `inside` - j px within the rim.
void EdgeModel::profile(double a, double b, double t, double sigma, double inside, int count,
                        Profile& out) const {
  // The rim's point, its unit normal (the gradient of x^2 / a^2 + y^2 / b^2) and tangent.
  const Eigen::Array2d point(a * std::cos(t), b * std::sin(t));
  const Eigen::Array2d inverse(1 / (a * a), 1 / (b * b));
  const Eigen::Array2d normal = (point * inverse) / (point * inverse).matrix().norm();
  const Eigen::Array2d tangent(-normal.y(), normal.x());
  std::fill_n(out.begin(), count, EdgeSample{});
  const double quadratic = (normal * normal * inverse).sum();
  for (std::size_t i = 0; i < kNodes.size(); ++i) {
    // Where a line beside the normal meets the rim, at s along it: quadratic s^2 + 2 linear s +
    // constant = 0.
    const Eigen::Array2d beside = point + sigma * kNodes[i] * tangent;
    const double linear = (beside * normal * inverse).sum();
    const double constant = (beside * beside * inverse).sum() - 1;
    const double root = linear * linear - quadratic * constant;
    if (root <= 0) continue;  // that line misses the body
    const double rim = (-linear + std::sqrt(root)) / quadratic;
    const double chord = 2 * std::sqrt(root) / quadratic;
    // n^2 = 1 - rho^2 = quadratic * depth * (chord - depth): n rises as a root, n^2 linearly; in
    // units of the blur.
    const double w = kNodeWeights[i];
    const double straight = quadratic * chord * sigma;
    const double k = sigma / chord;
    const Eigen::Vector3d scale(w, w * std::sqrt(straight), w * straight);
    // Heat equation: a Gaussian blur's derivative by sigma is sigma times the Laplacian. Across the
    // normal the second derivative is the mean of (x^2 - 1) f(x) over the nodes (Stein's identity).
    // So a change of the blur needs no second profile.
    const double across = kNodes[i] * kNodes[i] - 1;
    for (int j = 0; j < count; ++j) {
      const double depth = rim + inside - j;
      const double z = depth / sigma;
      const Blurred shades = blurred(z, k);
      EdgeSample& s = out[static_cast<std::size_t>(j)];
      if (2 * i + 1 == kNodes.size() && depth > 0) {
        const double facing = quadratic * depth * (chord - depth);  // n^2, without blur
        s.trust = 1 / (1 + std::pow(facing / kTrusted, 4));
      }
      s.value += scale.cwiseProduct(shades.value);
      s.by_shift += scale.cwiseProduct(shades.first) / sigma;
      s.by_blur += scale.cwiseProduct(shades.second + across * shades.value) / sigma;
    }
  }
}

}  // namespace vitreo::vision
