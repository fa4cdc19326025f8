// SPDX-License-Identifier: Apache-2.0
#include "host/safety/read_back.h"

#include <fmt/format.h>

#include <algorithm>

namespace vitreo {
namespace {

/// Within which a current follows its set-point.
constexpr Time kCurrentSettles = std::chrono::milliseconds(150);
constexpr int kContradictions = 2;

}  // namespace

void ReadBack::set(Time at, std::span<const double> currents) {
  lately_.push_back({at, {currents.begin(), currents.end()}});
  forget_before(at);
}

void ReadBack::forget_before(Time at) {
  while (lately_.size() > 1 && lately_[1].at <= at - kCurrentSettles) lately_.pop_front();
}

std::string ReadBack::judge(Time at, std::span<const double> measured) {
  forget_before(at);
  const std::string wrong = contradiction(measured);
  contradicted_ = wrong.empty() ? 0 : contradicted_ + 1;
  return contradicted_ < kContradictions ? "" : wrong;
}

std::string ReadBack::contradiction(std::span<const double> measured) const {
  if (lately_.empty()) return "";
  const std::vector<double>& set = lately_.back().currents;
  for (std::size_t channel = 0; channel < std::min(measured.size(), set.size()); ++channel) {
    double low = set[channel], high = set[channel];
    for (const Set& one : lately_) {
      low = std::min(low, one.currents[channel]);
      high = std::max(high, one.currents[channel]);
    }
    // Negated, so that a NaN contradicts.
    if (!(measured[channel] >= low - tolerance_ && measured[channel] <= high + tolerance_))
      return fmt::format("coil {}: {:.3g} A flow where {:.3g} A were set", channel + 1,
                         measured[channel], set[channel]);
  }
  return "";
}

}  // namespace vitreo
