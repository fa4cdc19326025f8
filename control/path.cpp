// SPDX-License-Identifier: Apache-2.0
#include "control/path.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::control {

Path::Path(std::vector<Eigen::Vector3d> waypoints, double speed) : waypoints_(std::move(waypoints)) {
  if (waypoints_.empty()) throw std::invalid_argument("waypoints: at least one is needed");
  if (!std::isfinite(speed) || speed <= 0) throw std::invalid_argument("speed: must be finite and above 0 m/s");
  double time = 0;
  for (std::size_t k = 0; k < waypoints_.size(); ++k) {
    if (!waypoints_[k].allFinite()) throw std::invalid_argument("waypoints: a number is not finite");
    if (k > 0) time += (waypoints_[k] - waypoints_[k - 1]).norm() / speed;
    arrival_.push_back(time);
  }
  if (!std::isfinite(time)) throw std::invalid_argument("speed: too slow for the path");
}

double Path::duration() const { return arrival_.back(); }

double Path::length() const {
  double sum = 0;
  for (std::size_t k = 1; k < waypoints_.size(); ++k) sum += (waypoints_[k] - waypoints_[k - 1]).norm();
  return sum;
}

Reference Path::at(double time) const {
  if (std::isnan(time)) throw std::invalid_argument("time: not a number");
  if (time < 0) return {waypoints_.front(), Eigen::Vector3d::Zero()};
  if (time >= duration()) return {waypoints_.back(), Eigen::Vector3d::Zero()};
  // The first waypoint still ahead; repeated points have no time between them, so they are stepped over.
  const auto next = std::upper_bound(arrival_.begin(), arrival_.end(), time);
  const auto k = static_cast<std::size_t>(next - arrival_.begin());
  const double begin = arrival_[k - 1], span = arrival_[k] - begin;
  const Eigen::Vector3d step = waypoints_[k] - waypoints_[k - 1];
  return {waypoints_[k - 1] + step * ((time - begin) / span), step / span};
}

}  // namespace vitreo::control
