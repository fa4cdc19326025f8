// SPDX-License-Identifier: Apache-2.0
#include "control/innovation_statistics.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

constexpr double kMostOfOne = 10;

}  // namespace

InnovationStatistics::InnovationStatistics(double memory) : memory_(memory) {
  require(positive(memory), "memory: must be above 0 s");
}

// The innovations are standardized, S = L L', z = L^-1 v, so that each coordinate counts the same
// (Bar-Shalom, Li & Kirubarajan 2001, 5.4.2).
void InnovationStatistics::add(const Innovation& innovation, double span) {
  const Eigen::Vector3d now =
      Eigen::LLT<Eigen::Matrix3d>(innovation.covariance).matrixL().solve(innovation.value);
  // The first weighs as much as the memory has time for: a mean from the begin on.
  const double fade = started_ ? std::exp(-std::max(span, 0.0) / memory_) : 0;
  normalized_ = fade * normalized_ + (1 - fade) * std::min(innovation.normalized / 3, kMostOfOne);
  power_ = fade * power_ + (1 - fade) * now.squaredNorm();
  if (started_) product_ = fade * product_ + (1 - fade) * now.dot(last_);
  last_ = now;
  started_ = true;
}

double InnovationStatistics::correlation() const {
  return power_ > 0 ? std::clamp(product_ / power_, -1.0, 1.0) : 0;
}

void InnovationStatistics::reset() { *this = InnovationStatistics(memory_); }

}  // namespace vitreo::control
