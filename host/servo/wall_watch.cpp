// SPDX-License-Identifier: Apache-2.0
#include "host/servo/wall_watch.h"

#include <algorithm>

namespace vitreo {

WallWatch::Verdict WallWatch::see(const WallSight& sight) {
  const control::WallClearance& wall = sight.clearance.nearest();
  if (!seen_ || wall.bound() >= margin_ - (inside_ ? 0 : kHysteresis)) outside_at_ = sight.time;
  if (!seen_ || wall.distance > kTouches) off_at_ = sight.time;
  const bool lying = sight.time - off_at_ >= kLies;
  seen_ = true;
  inside_ = sight.time - outside_at_ >= kBriefly;
  const double error = wall.normal.dot(sight.position - sight.target);
  const bool pushes = error > kError && wall.distance < kNear && !sight.kept_out;
  if (!pushes || lens_ != sight.clearance.at_lens()) pushing_.clear();
  lens_ = sight.clearance.at_lens();
  if (!pushes) return {inside_, false, lying};
  pushing_.push_back({sight.time, wall.normal.dot(sight.position)});
  while (pushing_.size() > 2 && pushing_[1].time <= sight.time - kLong) pushing_.pop_front();
  const bool long_enough = sight.time - pushing_.front().time >= kLong;
  const bool still = pushing_.front().along - pushing_.back().along < kStill;
  return {inside_, long_enough && still, lying};
}

void WallWatch::forget() {
  pushing_.clear();
  seen_ = false;
  inside_ = false;
}

}  // namespace vitreo
