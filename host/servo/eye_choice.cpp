// SPDX-License-Identifier: Apache-2.0
#include "host/servo/eye_choice.h"

#include <cmath>

namespace vitreo {
namespace {

// px and standard deviations between the centers of two outlines of one robot; and, of an axis,
// relative: each eye has a bias of its own.
constexpr double kSame_px = 1.5;
constexpr double kSameSigmas = 5;
constexpr double kSameAxes = 0.2;
// A variance is clearly better below this part of the other, for so many pictures: at each change
// of the eye the position jumps by the difference of their biases.
constexpr double kClearlyBetter = 0.4;
constexpr int kBetterFor = 8;

double noise_of(const Observation& seen) { return seen.noise().trace(); }

bool same_robot(const Observation& a, const Observation& b) {
  const vision::EllipseMeasurement& one = *a.ellipse;
  const vision::EllipseMeasurement& other = *b.ellipse;
  const double sigma = std::sqrt((one.covariance + other.covariance).topLeftCorner<2, 2>().trace());
  const auto alike = [](double x, double y) { return std::abs(x - y) < kSameAxes * (x + y) / 2; };
  return (one.ellipse.center_px - other.ellipse.center_px).norm() <
             kSame_px + kSameSigmas * sigma &&
         alike(one.ellipse.semi_major_px, other.ellipse.semi_major_px) &&
         alike(one.ellipse.semi_minor_px, other.ellipse.semi_minor_px);
}

}  // namespace

std::optional<std::size_t> EyeChoice::choose(const std::vector<Observation>& seen) {
  std::optional<std::size_t> best;
  contradicted_ = false;
  for (std::size_t k = 0; k < seen.size(); ++k) {
    if (!seen[k].position) continue;
    if (best && !same_robot(seen[*best], seen[k])) contradicted_ = true;
    if (!best || noise_of(seen[k]) < noise_of(seen[*best])) best = k;
  }
  if (contradicted_ || !best) return std::nullopt;
  const bool kept = eye_ && seen[*eye_].position;
  const bool clearly =
      kept && noise_of(seen[*best]) < kClearlyBetter * noise_of(seen[*eye_]) && best != eye_;
  better_ = clearly ? better_ + 1 : 0;
  if (!kept || better_ >= kBetterFor) {
    eye_ = best;
    better_ = 0;
  }
  return eye_;
}

}  // namespace vitreo
