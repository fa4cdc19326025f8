// SPDX-License-Identifier: Apache-2.0
#include "host/session/clock_map.h"

#include <cmath>

namespace vitreo {
namespace {

// Best pairs kept, one a second. Over 120 s a drift of 1e-6 adds up to 0.12 ms.
constexpr std::size_t kSeconds = 120;

}  // namespace

/// Minimum filter: the delay from the instrument to the host is never negative, so of each second
/// the pair with the smallest offset is the one nearest to the truth (as the clock filter of NTP,
/// RFC 5905 section 10).
void ClockMap::add(Time device, Time host) {
  const Pair pair{to_seconds(device), to_seconds(host - device)};
  // Its clock was set back or restarted: old pairs are of another scale.
  if (present_ && pair.device < present_->device) {
    best_.clear();
    present_.reset();
  }
  const double second = std::floor(pair.device);
  if (present_ && second == second_) {
    if (pair.offset < present_->offset) present_ = pair;
    return;
  }
  // A second is over.
  if (present_) best_.push_back(*present_);
  if (best_.size() > kSeconds) best_.pop_front();
  present_ = pair;
  second_ = second;
}

/// Least squares: offset = mean + drift (t - mean t), with drift = S_to / S_tt of the centered
/// sums; evaluated at the last pair. Centered first, since times since an instrument's start may be
/// large.
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
  // One pair has no slope.
  const double drift = square > 0 ? both / square : 0;
  return ClockOffset{offset + drift * (best_.back().device - device), drift};
}

}  // namespace vitreo
