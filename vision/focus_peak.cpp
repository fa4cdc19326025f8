// SPDX-License-Identifier: Apache-2.0
#include "vision/focus_peak.h"

#include "vision/preconditions.h"
#include "vision/robust.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

namespace vitreo::vision {
namespace {

constexpr double kLeastWeight = 0.05;   // three points are needed, whatever their weight
constexpr double kShareOfHeight = 0.6;  // of the curve's height that the parabola covers at most
constexpr int kPeakRounds = 4;
// Of the largest value, to which values are raised: what is 0 or below has no logarithm.
constexpr double kLeastShare = 1e-4;

struct PeakPoint {
  double x;
  double y;  // logarithm of the measure
  // y smoothed along x: it decides which points count, so that one lucky frame does not.
  double smooth = 0;
};

// Sorted by position, the mean of samples at the same one; the logarithm turns a Gaussian peak into
// a parabola and a lamp's factor into an offset.
// Empty when all values are 0 or less: a blank sweep has no peak. Throws std::invalid_argument for
// a sample that is not finite.
std::vector<PeakPoint> points_of(std::span<const FocusSample> samples) {
  std::vector<FocusSample> sorted(samples.begin(), samples.end());
  for (const FocusSample& s : sorted) {
    require(std::isfinite(s.position), "samples: a position is not finite");
    require(std::isfinite(s.value), "samples: a value is not finite");
  }
  // By value too, so that the sums below do not depend on the order given.
  std::sort(sorted.begin(), sorted.end(), [](const FocusSample& a, const FocusSample& b) {
    return a.position != b.position ? a.position < b.position : a.value < b.value;
  });
  double largest = 0;
  for (const FocusSample& s : sorted) largest = std::max(largest, s.value);
  std::vector<PeakPoint> points;
  if (largest <= 0) return points;
  for (std::size_t i = 0; i < sorted.size();) {
    double sum = 0;
    std::size_t end = i;
    for (; end < sorted.size() && sorted[end].position == sorted[i].position; ++end)
      sum += sorted[end].value;
    points.push_back({sorted[i].position, std::log(std::max(sum / static_cast<double>(end - i),
                                                            kLeastShare * largest))});
    i = end;
  }
  return points;
}

bool lower(const PeakPoint& a, const PeakPoint& b) { return a.y < b.y; }
bool smoothly_lower(const PeakPoint& a, const PeakPoint& b) { return a.smooth < b.smooth; }

// Relative noise of one sample, as the standard deviation of its logarithm.
// known: from eight residuals or more, enough for the median to be trusted.
struct SampleNoise {
  double sigma;  // of one point's y
  bool known;    // from many points, not guessed from few
};

// On a copy, since the order of the values still matters to the caller.
double median_copy(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Noise from the residuals of Lagrange's cubic through the two neighbors on either side: such a
// residual y - sum w_k y_k has the variance (1 + sum w_k^2) sigma^2. The curve itself bends little
// over five samples but for those at the peak, which the median absolute residual ignores.
// `least`: the relative noise that is assumed at least, as few samples may agree by chance.
SampleNoise noise_of(const std::vector<PeakPoint>& p, double least) {
  std::vector<double> misses;
  const double floor = std::max_element(p.begin(), p.end(), lower)->y + std::log(2 * kLeastShare);
  for (std::size_t i = 2; i + 2 < p.size(); ++i) {
    if (p[i].y < floor) continue;  // raised to kLeastShare: equal for another reason than low noise
    const std::array<std::size_t, 4> others{i - 2, i - 1, i + 1, i + 2};
    double predicted = 0;
    double squares = 1;
    for (const std::size_t a : others) {
      double weight = 1;  // Lagrange's polynomial of `a` at x_i
      for (const std::size_t b : others) {
        if (b != a) weight *= (p[i].x - p[b].x) / (p[a].x - p[b].x);
      }
      predicted += weight * p[a].y;
      squares += weight * weight;
    }
    misses.push_back(std::abs(p[i].y - predicted) / std::sqrt(squares));
  }
  // From fewer than three residuals no median; from fewer than eight it is uncertain.
  if (misses.size() < 3) return {least, false};
  return {std::max(kMadToSigma * median_copy(misses), least), misses.size() >= 8};
}

// Binomial mean (1 2 1) / 4 of neighbors, one-sided at the ends.
// Only for choosing points and the top; the parabola is fitted to the values themselves.
void smooth_points(std::vector<PeakPoint>& p) {
  for (std::size_t i = 0; i < p.size(); ++i) {
    double y = 2 * p[i].y;
    double weight = 2;
    if (i > 0) y += p[i - 1].y, ++weight;
    if (i + 1 < p.size()) y += p[i + 1].y, ++weight;
    p[i].smooth = y / weight;
  }
}

// In t, so that coefficients and their covariance are of one size.
struct Parabola {  // y = c0 + c1 t + c2 t^2 with t = (x - middle) / scale
  double middle = 0;
  double scale = 1;
  Eigen::Vector3d c = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  bool good = false;
  // t where the derivative c1 + 2 c2 t vanishes.
  double vertex() const { return -c[1] / (2 * c[2]); }
  // Its standard deviation by first-order propagation: d vertex = (0, -1 / (2 c2), c1 / (2 c2^2))
  // dc.
  double sigma() const {
    const Eigen::Vector3d slope(0, -1 / (2 * c[2]), c[1] / (2 * c[2] * c[2]));
    return std::sqrt(slope.dot(covariance * slope));
  }
};

Eigen::Vector3d parabola_row(const Parabola& f, const PeakPoint& p) {
  const double t = (p.x - f.middle) / f.scale;
  return {1, t, t * t};
}

// Weighted least squares; false when the points do not determine a parabola. The weights are no
// inverse variances, so the covariance is the sandwich s^2 (X'WX)^-1 X'W^2X (X'WX)^-1.
// That is the covariance of this estimator for errors of equal variance s^2.
bool solve_parabola(Parabola& f, std::span<const PeakPoint> p, const std::vector<double>& weight,
                    const SampleNoise& noise) {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d spread = information;
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double sum = 0;
  double chi = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const Eigen::Vector3d row = parabola_row(f, p[i]);
    information += weight[i] * row * row.transpose();
    spread += weight[i] * weight[i] * row * row.transpose();
    right += weight[i] * p[i].y * row;
    sum += weight[i];
  }
  const Eigen::LDLT<Eigen::Matrix3d> solver(information);
  if (solver.info() != Eigen::Success || solver.rcond() < 1e-10) return false;
  f.c = solver.solve(right);
  for (std::size_t i = 0; i < p.size(); ++i)
    chi += weight[i] * std::pow(p[i].y - f.c.dot(parabola_row(f, p[i])), 2);
  const double known = noise.sigma * noise.sigma;
  // A curve's deviation from a parabola is no noise: the residual variance, with three degrees of
  // freedom less, counts only while the noise is not known from enough samples.
  const double variance = !noise.known && sum > 3.5 ? std::max(known, chi / (sum - 3)) : known;
  const Eigen::Matrix3d inverse = solver.solve(Eigen::Matrix3d::Identity());
  f.covariance = variance * inverse * spread * inverse;
  return true;
}

// Robust parabola through `p` by iteratively re-weighted least squares (Tukey). The weight also
// falls from the highest point to `lowest`: with a hard cut, a point more on one side would shift
// the peak. x is scaled to [-1, 1], which keeps the normal equations well conditioned.
// Returns `good` false where the points bend upwards or not clearly downwards.
Parabola fit_parabola(std::span<const PeakPoint> p, double lowest, const SampleNoise& noise) {
  Parabola f;
  f.middle = (p.front().x + p.back().x) / 2;
  f.scale = (p.back().x - p.front().x) / 2;
  const double highest = std::max_element(p.begin(), p.end(), smoothly_lower)->smooth;
  std::vector<double> share;
  std::vector<double> weight;
  for (const PeakPoint& q : p)
    share.push_back(std::max((q.smooth - lowest) / (highest - lowest), kLeastWeight));
  weight = share;
  for (int round = 0; round <= kPeakRounds; ++round) {
    if (!solve_parabola(f, p, weight, noise)) return f;
    std::vector<double> misses;
    for (const PeakPoint& q : p) misses.push_back(std::abs(q.y - f.c.dot(parabola_row(f, q))));
    const double limit = kTukey * std::max(noise.sigma, kMadToSigma * median_copy(misses));
    // Fewer than five samples cannot show which of them is wrong.
    for (std::size_t i = 0; i < p.size() && p.size() >= 5; ++i) {
      const double r = misses[i] / limit;
      weight[i] = r < 1 ? share[i] * (1 - r * r) * (1 - r * r) : 0;
    }
  }
  // The vertex is a maximum when the curvature is negative by three standard deviations.
  f.good = f.c[2] < -3 * std::sqrt(f.covariance(2, 2));
  return f;
}

// The run of samples about the top that stand higher than `lowest`, one on either side at least.
// `top` is not at an end. Contiguous, so that a second maximum behind a valley is left out.
std::span<const PeakPoint> about(const std::vector<PeakPoint>& p, std::size_t top, double lowest) {
  std::size_t begin = top - 1;
  std::size_t end = top + 2;
  while (begin > 0 && p[begin - 1].smooth >= lowest) --begin;
  while (end < p.size() && p[end].smooth >= lowest) ++end;
  return std::span(p).subspan(begin, end - begin);
}

// The curve still rises at an end: no interpolation, but the direction in which to go on.
// The stage has not gone far enough on that side; a result, not an error.
FocusPeakFit at_end(FocusPeakFit result, bool low) {
  result.answer = low ? FocusAnswer::at_low_end : FocusAnswer::at_high_end;
  return result;
}

}  // namespace

std::string_view name_of(FocusAnswer answer) {
  switch (answer) {
    case FocusAnswer::found:
      return "found";
    case FocusAnswer::at_low_end:
      return "at low end";
    case FocusAnswer::at_high_end:
      return "at high end";
    case FocusAnswer::no_peak:
      break;
  }
  return "no peak";
}

void FocusPeakSettings::check() const {
  require(depth > 0 && std::isfinite(depth), "depth: must be positive");
  require(least_noise > 0 && std::isfinite(least_noise), "least_noise: must be positive");
  require(significance > 0 && std::isfinite(significance), "significance: must be positive");
}

// Significance, then the ends, then the parabola over the upper part of the peak; a second,
// narrower fit shows how far the curve deviates from a parabola.
// Positions in the caller's unit. Sigma holds noise and the curve's deviation from a parabola,
// added in squares.
FocusPeakFit find_focus_peak(std::span<const FocusSample> samples,
                             const FocusPeakSettings& settings) {
  settings.check();
  std::vector<PeakPoint> points = points_of(samples);
  FocusPeakFit result;
  if (points.size() < 3) return result;
  const SampleNoise noise = noise_of(points, settings.least_noise);
  result.noise = noise.sigma;
  smooth_points(points);
  const auto [low, high] = std::minmax_element(points.begin(), points.end(), smoothly_lower);
  const double highest = high->smooth;
  const double height = highest - low->smooth;
  // Significance in units of one sample's noise.
  if (height < settings.significance * noise.sigma) return result;
  const auto top = static_cast<std::size_t>(high - points.begin());
  if (top == 0 || top + 1 == points.size()) return at_end(result, top == 0);
  // Of a low peak on a high floor, the foot is no parabola either.
  const double depth = std::min(settings.depth, kShareOfHeight * height);
  const Parabola wide = fit_parabola(about(points, top, highest - depth), highest - depth, noise);
  const Parabola narrow =
      fit_parabola(about(points, top, highest - depth / 2), highest - depth / 2, noise);
  if (!wide.good) return result;
  const double position = wide.middle + wide.scale * wide.vertex();
  if (position < points.front().x || position > points.back().x)
    return at_end(result, position < points.front().x);
  // Fits of different depth agree on a parabola, and only there: the difference counts as an error.
  double bend = 0;
  if (narrow.good) bend = narrow.middle + narrow.scale * narrow.vertex() - position;
  result.answer = FocusAnswer::found;
  const double t = wide.vertex();
  result.peak = FocusPeak{position, std::hypot(wide.scale * wide.sigma(), bend),
                          std::exp(wide.c.dot(Eigen::Vector3d(1, t, t * t)))};
  return result;
}

}  // namespace vitreo::vision
