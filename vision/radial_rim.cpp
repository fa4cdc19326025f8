// SPDX-License-Identifier: Apache-2.0
#include "vision/radial_rim.h"

#include "vision/preconditions.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo::vision {
namespace {

constexpr int kMostSamples = 40;
constexpr double kCutVariance = 0.16;  // px^2 of one cut; the fit scales it to the scatter
constexpr double kConverged = 0.05;    // px: a further round would change less than the scatter
// Smallest number of neighboring normals with a common error: evidence is smoothed over 3 px.
constexpr double kLeastCorrelated = 2;
// px: step of a round below which the residuals are errors, not yet a wrong ellipse.
constexpr double kNearlyConverged = 0.5;
constexpr double kMostF = 4;  // bound of |F|: one sure color must not outweigh its neighbors

}  // namespace

void RadialRimSettings::check() const {
  require(normals >= 16 && normals <= 1024, "normals: must be 16 to 1024");
  require(search_px >= 2 && search_px <= 16, "search_px: must be 2 to 16");
  require(rounds >= 1 && rounds <= 20, "rounds: must be 1 to 20");
}

RadialRim::RadialRim(const RadialRimSettings& settings) : settings_(settings) {
  settings.check();
  normals_.resize(static_cast<std::size_t>(settings.normals));
  steps_.resize(normals_.size());
}

// Maximum-likelihood change point on a normal: F is a log-likelihood ratio, so the cut after sample
// k has the log-likelihood sum_(j <= k) F_j less a constant, and the best cut ends the largest
// cumulative sum. To a fraction of a px by the linear zero crossing of F beside the cut.
// Samples end at the first blocked pixel: what follows belongs to another object or lies outside of
// the gate.
void RadialRim::cut(const Evidence& evidence, Normal& n, double depth_px) const {
  std::array<double, kMostSamples> f;
  const int reach = static_cast<int>(settings_.search_px);
  int first = -reach;
  int count = 0;
  // Not through the center: beyond it a thin object's other rim comes.
  while (-first > 0.9 * depth_px) ++first;
  for (int k = first; k <= reach && count < kMostSamples; ++k) {
    const Eigen::Vector2d at = n.rim_px + k * n.outward;
    const double value = evidence.between(at.x(), at.y());
    if (!std::isfinite(value)) break;
    f[static_cast<std::size_t>(count++)] = std::clamp(value, -kMostF, kMostF);
  }
  if (count < 4) return;
  double sum = 0;
  double best = 0;
  int last = -1;  // of the samples inside
  for (int k = 0; k < count; ++k) {
    sum += f[static_cast<std::size_t>(k)];
    if (sum > best) best = sum, last = k;
  }
  if (last < 0 || last + 1 >= count) return;
  const double inside = f[static_cast<std::size_t>(last)];
  const double outside = f[static_cast<std::size_t>(last) + 1];
  if (!(inside > outside)) return;
  n.found = true;
  n.shift_px = first + last + inside / (inside - outside);
  n.variance = kCutVariance;
  n.contrast = f[static_cast<std::size_t>(std::max(last - 1, 0))] -
               f[static_cast<std::size_t>(std::min(last + 2, count - 1))];
}

// Gauss-Newton: cuts along the current ellipse's normals, then the robust fit, until it moves no
// more.
// A normal that is blocked counts as not found, so a covered rim lowers inlier_fraction, by which
// the tracker judges.
std::optional<EllipseMeasurement> RadialRim::measure(const Evidence& evidence, const Ellipse& start,
                                                     const EllipsePrior& prior) {
  Ellipse ellipse = start;
  FittedEllipse fitted;
  double correlation_length = kLeastCorrelated;
  for (int round = 0; round < settings_.rounds; ++round) {
    place_normals(ellipse, normals_);
    for (Normal& n : normals_) cut(evidence, n, ellipse.semi_minor_px);
    fitted = fit_ellipse(ellipse, normals_, &prior, correlation_length);
    if (!fitted.valid) return std::nullopt;
    const double moved = (fitted.ellipse.center_px - ellipse.center_px).norm() +
                         (fitted.ellipse.shape() - ellipse.shape()).norm();
    ellipse = fitted.ellipse;
    if (moved < kNearlyConverged)
      correlation_length = std::max(integrated_autocorrelation(normals_), kLeastCorrelated);
    if (moved < kConverged) break;
  }
  EllipseMeasurement result{ellipse, fitted.covariance, 0, 0};
  auto end = steps_.begin();
  for (const Normal& n : normals_) {
    if (n.found && n.weight > 0) *end++ = n.contrast;
  }
  // Of the normals that the image has; its border cuts an object whose center is in it to about
  // half.
  const auto searched = std::count_if(normals_.begin(), normals_.end(), [&](const Normal& n) {
    return evidence.in_image(n.rim_px.x(), n.rim_px.y());
  });
  result.inlier_fraction =
      static_cast<double>(end - steps_.begin()) /
      std::max(static_cast<double>(searched), 0.4 * static_cast<double>(normals_.size()));
  const auto middle = steps_.begin() + (end - steps_.begin()) / 2;
  std::nth_element(steps_.begin(), middle, end);
  result.contrast = *middle;
  return result;
}

}  // namespace vitreo::vision
