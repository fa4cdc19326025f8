// SPDX-License-Identifier: Apache-2.0
#include "control/standstill.h"

#include <algorithm>

namespace vitreo::control {
namespace {

constexpr double kMemory = 20;       // s
constexpr double kLeastSpan = 1.25;  // s
constexpr double kToldSigmas = 10;
// Of a coordinate, from the mean of all: of some dozens of places none is farther by chance.
constexpr double kPlaceSigmas = 4.5;
constexpr double kPlace = 5e-6;  // m

}  // namespace

void Standstill::add(double time, const Eigen::Vector3d& place, double sigma,
                     const Eigen::Vector3d& told) {
  if (!lately_.empty() && time == lately_.back().time) return;
  if (!lately_.empty() && time < lately_.back().time) reset();
  const Eigen::Vector3d before =
      lately_.empty() ? Eigen::Vector3d::Zero() : Eigen::Vector3d(lately_.back().told + told);
  lately_.push_back({time, place, sigma, before});
  while (lately_.front().time < time - kMemory) lately_.pop_front();
  stands_ = look();
}

bool Standstill::look() const {
  const Seen& now = lately_.back();
  const auto first = std::find_if(lately_.rbegin(), lately_.rend(), [this, &now](const Seen& one) {
    return now.time - one.time >= kLeastSpan &&
           (now.told - one.told).norm() >= std::max(least_told_, kToldSigmas * now.sigma);
  });
  if (first == lately_.rend()) return false;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double sigma = 0;
  for (auto one = lately_.rbegin(); one <= first; ++one) {
    mean += one->place / static_cast<double>(first - lately_.rbegin() + 1);
    sigma = std::max(sigma, one->sigma);
  }
  return std::all_of(lately_.rbegin(), first + 1, [&](const Seen& one) {
    return (one.place - mean).cwiseAbs().maxCoeff() <= kPlaceSigmas * sigma + kPlace;
  });
}

}  // namespace vitreo::control
