// SPDX-License-Identifier: Apache-2.0
#include "vision/radial_rim.h"

#include "vision/preconditions.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo::vision {
namespace {

constexpr int kMostSamples = Evidence::kMostAlong;
constexpr double kCutVariance = 0.16;  // px^2 of one cut; the fit scales it to the scatter
// px^2: what of it a sharp step of one image scatters by. The variance of a step that is softer by
// s is kCutVariance (1 + s^2 / 3 / kSharpVariance): its cut lies anywhere on that way, at one end
// of which the rim is.
constexpr double kSharpVariance = 0.1;
// Quartiles of the softness round a rim: the lower one is that of the image.
constexpr double kUsualShare = 0.25;
constexpr double kSoftShare = 0.75;
constexpr int kFewestSteps = 8;      // of which shares can be told
constexpr double kConverged = 0.05;  // px: a further round would change less than the scatter
// Smallest number of neighboring normals with a common error: evidence is smoothed over 3 px.
constexpr double kLeastCorrelated = 2;
// px: step of a round below which the residuals are errors, not yet a wrong ellipse.
constexpr double kNearlyConverged = 0.5;
constexpr double kMostF = 4;  // bound of |F|: one sure color must not outweigh its neighbors
// Mean |F| below which pixels have a color that training did not show: F of such is log(e / e) = 0
// exactly. Colors that object and ground share scatter about 0, by more than a step of the table.
constexpr double kForeignF = 1 / ColorModel::kScale;
constexpr int kForeignFrom = 2;  // px beyond the cut, where blur mixes colors no more
constexpr int kForeignEnd = 5;
constexpr double kUnbounded = 8;  // F of a table is within +-7.9
// Of a normal that something covers, in the number of those that should have been found: half of
// it, lest half a rim count as a whole one.
constexpr double kCoveredCount = 0.5;
// Share of the normals that end at the ground, from which the others can be done without.
constexpr double kEnoughRim = 0.4;

// Whether a cut is the edge of something that lies over the object: what is beyond it has a color
// that neither object nor ground have shown.
bool ends_at_cover(const Evidence& evidence, const Normal& n) {
  constexpr int kCount = kForeignEnd - kForeignFrom;
  std::array<std::int64_t, kCount> f;
  const Eigen::Vector2d from = n.rim_px + (n.shift_px + kForeignFrom) * n.outward;
  if (evidence.along(from, n.outward, kCount, kUnbounded, f.data()) < kCount) return false;
  std::int64_t beyond = 0;
  for (const std::int64_t value : f) beyond += std::abs(value);
  return static_cast<double>(beyond) < kForeignF * kCount * Evidence::kAlongScale;
}

// Takes the cuts at a cover's edge out, where enough of the rim is left without them, and returns
// how many. In a light that training did not show all of the ground is foreign, and the cuts are
// all there is.
int leave_out_covered(const Evidence& evidence, std::vector<Normal>& normals) {
  std::array<bool, 1024> covered{};  // as many normals as the settings allow
  int of_rim = 0;
  int hidden = 0;
  for (std::size_t k = 0; k < normals.size(); ++k) {
    if (!normals[k].found) continue;
    covered[k] = ends_at_cover(evidence, normals[k]);
    ++(covered[k] ? hidden : of_rim);
  }
  if (of_rim < kEnoughRim * static_cast<double>(normals.size())) return 0;
  for (std::size_t k = 0; k < normals.size(); ++k)
    if (covered[k]) normals[k].found = false;
  return hidden;
}

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
  std::array<std::int64_t, kMostSamples> f;  // in units of 1 / kAlongScale
  const int reach = static_cast<int>(settings_.search_px);
  int first = -reach;
  // Not through the center: beyond it a thin object's other rim comes.
  while (-first > 0.9 * depth_px) ++first;
  const int count = evidence.along(n.rim_px + first * n.outward, n.outward,
                                   std::min(reach - first + 1, kMostSamples), kMostF, f.data());
  if (count < 4) return;
  std::int64_t sum = 0;
  std::int64_t best = 0;
  int last = -1;  // of the samples inside
  for (int k = 0; k < count; ++k) {
    sum += f[static_cast<std::size_t>(k)];
    if (sum > best) best = sum, last = k;
  }
  if (last < 0 || last + 1 >= count) return;
  const auto inside = static_cast<double>(f[static_cast<std::size_t>(last)]);
  const auto outside = static_cast<double>(f[static_cast<std::size_t>(last) + 1]);
  if (!(inside > outside)) return;
  n.found = true;
  n.shift_px = first + last + inside / (inside - outside);
  n.variance = kCutVariance;
  const int around = std::max(last - 2, 0);
  const int beyond = std::min(last + 4, count);
  std::int64_t sure = 0;
  for (int k = around; k < beyond; ++k) sure += std::abs(f[static_cast<std::size_t>(k)]);
  n.softness_px = beyond - around - static_cast<double>(sure) / (kMostF * Evidence::kAlongScale);
  n.contrast = static_cast<double>(f[static_cast<std::size_t>(std::max(last - 1, 0))] -
                                   f[static_cast<std::size_t>(std::min(last + 2, count - 1))]) /
               Evidence::kAlongScale;
}

// Shaded ground beside the object, or a vessel of nearly its color, has colors that speak for
// neither side: the cut lies anywhere in them, and all along one side of the rim by the same error,
// which no scatter shows. So a step softer than the rim's sharper ones, which are as soft as the
// image is, counts for less, and how uneven the rim is becomes a feature of the look.
void RadialRim::weigh_by_softness() {
  unevenness_px_ = 0;
  auto end = steps_.begin();
  for (const Normal& n : normals_)
    if (n.found) *end++ = n.softness_px;
  if (end - steps_.begin() < kFewestSteps) return;
  const auto at = [&](double share) {
    return steps_.begin() +
           static_cast<std::ptrdiff_t>(share * static_cast<double>(end - steps_.begin()));
  };
  std::nth_element(steps_.begin(), at(kUsualShare), end);
  const double usual = *at(kUsualShare);
  std::nth_element(at(kUsualShare), at(kSoftShare), end);
  unevenness_px_ = *at(kSoftShare) - usual;
  for (Normal& n : normals_) {
    const double more = std::max(n.softness_px - usual, 0.0);
    n.variance = kCutVariance * (1 + more * more / (3 * kSharpVariance));
  }
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
  int covered = 0;
  for (int round = 0; round < settings_.rounds; ++round) {
    place_normals(ellipse, normals_);
    for (Normal& n : normals_) cut(evidence, n, ellipse.semi_minor_px);
    covered = leave_out_covered(evidence, normals_);
    weigh_by_softness();
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
  result.inlier_fraction = static_cast<double>(end - steps_.begin()) /
                           std::max(static_cast<double>(searched) - kCoveredCount * covered,
                                    0.4 * static_cast<double>(normals_.size()));
  const auto middle = steps_.begin() + (end - steps_.begin()) / 2;
  std::nth_element(steps_.begin(), middle, end);
  result.contrast = *middle;
  return result;
}

}  // namespace vitreo::vision
