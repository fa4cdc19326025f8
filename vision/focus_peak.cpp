// SPDX-License-Identifier: Apache-2.0
#include "vision/focus_peak.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo::vision {
namespace {

constexpr double kTukey = 4.685;        // the usual 95 % efficiency
constexpr double kMadToSigma = 1.4826;  // of a normal distribution
constexpr double kLeastWeight = 0.05;   // three points are needed, whatever their weight
constexpr double kShareOfHeight = 0.6;
constexpr int kReweightings = 4;
constexpr double kLeastShare = 1e-4;  // of the largest value: what is 0 or below has no logarithm

struct Point {
  double x, y;  // y: logarithm of the measure
  double smooth =
      0;  // y smoothed along x: what decides which points count, so that one lucky frame does not
};

// By position, means of what was measured at the same one.
std::vector<Point> points_of(std::span<const FocusSample> samples) {
  std::vector<FocusSample> sorted(samples.begin(), samples.end());
  for (const FocusSample& s : sorted) {
    if (!std::isfinite(s.position))
      throw std::invalid_argument("samples: a position is not finite");
    if (!std::isfinite(s.value)) throw std::invalid_argument("samples: a value is not finite");
  }
  // By value too, so that the sums below do not depend on the order given.
  std::sort(sorted.begin(), sorted.end(), [](const FocusSample& a, const FocusSample& b) {
    return a.position != b.position ? a.position < b.position : a.value < b.value;
  });
  double largest = 0;
  for (const FocusSample& s : sorted) largest = std::max(largest, s.value);
  std::vector<Point> points;
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

bool lower(const Point& a, const Point& b) { return a.y < b.y; }
bool smoothly_lower(const Point& a, const Point& b) { return a.smooth < b.smooth; }

struct Noise {
  double sigma;  // of one point's y
  bool known;    // from many points, not guessed from few
};

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// What the cubic through the two neighbors on either side misses, scaled to one sample's noise. The
// curve itself bends little over five samples but for those at the peak, which the median ignores.
Noise noise_of(const std::vector<Point>& p, double least) {
  std::vector<double> misses;
  const double floor = std::max_element(p.begin(), p.end(), lower)->y + std::log(2 * kLeastShare);
  for (std::size_t i = 2; i + 2 < p.size(); ++i) {
    if (p[i].y < floor) continue;  // all alike, which is not for want of noise
    const std::array<std::size_t, 4> others{i - 2, i - 1, i + 1, i + 2};
    double predicted = 0, squares = 1;
    for (const std::size_t a : others) {
      double weight = 1;  // Lagrange
      for (const std::size_t b : others) {
        if (b != a) weight *= (p[i].x - p[b].x) / (p[a].x - p[b].x);
      }
      predicted += weight * p[a].y;
      squares += weight * weight;
    }
    misses.push_back(std::abs(p[i].y - predicted) / std::sqrt(squares));
  }
  if (misses.size() < 3) return {least, false};
  return {std::max(kMadToSigma * median(misses), least), misses.size() >= 8};
}

void smooth(std::vector<Point>& p) {
  for (std::size_t i = 0; i < p.size(); ++i) {
    double y = 2 * p[i].y, weight = 2;
    if (i > 0) y += p[i - 1].y, ++weight;
    if (i + 1 < p.size()) y += p[i + 1].y, ++weight;
    p[i].smooth = y / weight;
  }
}

struct Parabola {  // y = c0 + c1 t + c2 t^2 with t = (x - middle) / scale
  double middle = 0, scale = 1;
  Eigen::Vector3d c = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  bool good = false;
  double vertex() const { return -c[1] / (2 * c[2]); }
  double sigma() const {
    const Eigen::Vector3d slope(0, -1 / (2 * c[2]), c[1] / (2 * c[2] * c[2]));
    return std::sqrt(slope.dot(covariance * slope));
  }
};

Eigen::Vector3d row_of(const Parabola& f, const Point& p) {
  const double t = (p.x - f.middle) / f.scale;
  return {1, t, t * t};
}

// Weighted least squares; false when the points do not hold a parabola.
bool solve(Parabola& f, std::span<const Point> p, const std::vector<double>& weight,
           const Noise& noise) {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero(), spread = information;
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double sum = 0, chi = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const Eigen::Vector3d row = row_of(f, p[i]);
    information += weight[i] * row * row.transpose();
    spread += weight[i] * weight[i] * row * row.transpose();
    right += weight[i] * p[i].y * row;
    sum += weight[i];
  }
  const Eigen::LDLT<Eigen::Matrix3d> solver(information);
  if (solver.info() != Eigen::Success || solver.rcond() < 1e-10) return false;
  f.c = solver.solve(right);
  for (std::size_t i = 0; i < p.size(); ++i)
    chi += weight[i] * std::pow(p[i].y - f.c.dot(row_of(f, p[i])), 2);
  const double known = noise.sigma * noise.sigma;
  // What a curve bends off a parabola is no noise: the residual counts only while the noise is not
  // known better.
  const double variance = !noise.known && sum > 3.5 ? std::max(known, chi / (sum - 3)) : known;
  const Eigen::Matrix3d inverse = solver.solve(Eigen::Matrix3d::Identity());
  f.covariance = variance * inverse * spread * inverse;
  return true;
}

// The weight falls from the highest point to `lowest`: with a hard cut, a point more on one side
// would pull the peak.
Parabola fit(std::span<const Point> p, double lowest, const Noise& noise) {
  Parabola f;
  f.middle = (p.front().x + p.back().x) / 2;
  f.scale = (p.back().x - p.front().x) / 2;
  const double highest = std::max_element(p.begin(), p.end(), smoothly_lower)->smooth;
  std::vector<double> share, weight;
  for (const Point& q : p)
    share.push_back(std::max((q.smooth - lowest) / (highest - lowest), kLeastWeight));
  weight = share;
  for (int round = 0; round <= kReweightings; ++round) {
    if (!solve(f, p, weight, noise)) return f;
    std::vector<double> misses;
    for (const Point& q : p) misses.push_back(std::abs(q.y - f.c.dot(row_of(f, q))));
    const double limit = kTukey * std::max(noise.sigma, kMadToSigma * median(misses));
    // Five samples are needed to tell which of them is wrong.
    for (std::size_t i = 0; i < p.size() && p.size() >= 5; ++i) {
      const double r = misses[i] / limit;
      weight[i] = r < 1 ? share[i] * (1 - r * r) * (1 - r * r) : 0;
    }
  }
  // A vertex is one when the curve bends down beyond doubt.
  f.good = f.c[2] < -3 * std::sqrt(f.covariance(2, 2));
  return f;
}

// The run of samples about the top that stand higher than `lowest`, one on either side at least.
std::span<const Point> about(const std::vector<Point>& p, std::size_t top, double lowest) {
  std::size_t begin = top - 1, end = top + 2;
  while (begin > 0 && p[begin - 1].smooth >= lowest) --begin;
  while (end < p.size() && p[end].smooth >= lowest) ++end;
  return std::span(p).subspan(begin, end - begin);
}

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
  const auto positive = [](double value, const char* name) {
    if (!(value > 0 && std::isfinite(value)))
      throw std::invalid_argument(std::string(name) + ": must be positive");
  };
  positive(depth, "depth");
  positive(least_noise, "least_noise");
  positive(significance, "significance");
}

FocusPeakFit find_focus_peak(std::span<const FocusSample> samples,
                             const FocusPeakSettings& settings) {
  settings.check();
  std::vector<Point> points = points_of(samples);
  FocusPeakFit result;
  if (points.size() < 3) return result;
  const Noise noise = noise_of(points, settings.least_noise);
  result.noise = noise.sigma;
  smooth(points);
  const auto [low, high] = std::minmax_element(points.begin(), points.end(), smoothly_lower);
  const double highest = high->smooth, height = highest - low->smooth;
  if (height < settings.significance * noise.sigma) return result;
  const auto top = static_cast<std::size_t>(high - points.begin());
  if (top == 0 || top + 1 == points.size()) return at_end(result, top == 0);
  // A low peak on a high floor: its foot is no parabola either.
  const double depth = std::min(settings.depth, kShareOfHeight * height);
  const Parabola wide = fit(about(points, top, highest - depth), highest - depth, noise);
  const Parabola narrow = fit(about(points, top, highest - depth / 2), highest - depth / 2, noise);
  if (!wide.good) return result;
  const double position = wide.middle + wide.scale * wide.vertex();
  if (position < points.front().x || position > points.back().x)
    return at_end(result, position < points.front().x);
  double bend = 0;  // fits of different depth agree on a parabola, and only there
  if (narrow.good) bend = narrow.middle + narrow.scale * narrow.vertex() - position;
  result.answer = FocusAnswer::found;
  const double t = wide.vertex();
  result.peak = FocusPeak{position, std::hypot(wide.scale * wide.sigma(), bend),
                          std::exp(wide.c.dot(Eigen::Vector3d(1, t, t * t)))};
  return result;
}

}  // namespace vitreo::vision
