// SPDX-License-Identifier: Apache-2.0
#include "host/session/clock_map.h"

#include <cmath>

namespace vitreo {
namespace {

constexpr std::size_t kSeconds = 120;

}  // namespace

void ClockMap::add(Time device, Time host) {
  const Pair pair{to_seconds(device), to_seconds(host - device)};
  if (present_ && pair.device < present_->device) {
    best_.clear();
    present_.reset();
  }
  const double second = std::floor(pair.device);
  if (present_ && second == second_) {
    if (pair.offset < present_->offset) present_ = pair;
    return;
  }
  if (present_) best_.push_back(*present_);
  if (best_.size() > kSeconds) best_.pop_front();
  present_ = pair;
  second_ = second;
}

std::optional<ClockOffset> ClockMap::now() const {
  if (best_.empty()) return std::nullopt;
  double device = 0, offset = 0;
  for (const Pair& pair : best_) {
    device += pair.device;
    offset += pair.offset;
  }
  const auto count = static_cast<double>(best_.size());
  device /= count;
  offset /= count;
  double both = 0, square = 0;
  for (const Pair& pair : best_) {
    both += (pair.device - device) * (pair.offset - offset);
    square += (pair.device - device) * (pair.device - device);
  }
  const double drift = square > 0 ? both / square : 0;
  return ClockOffset{offset + drift * (best_.back().device - device), drift};
}

}  // namespace vitreo
