// SPDX-License-Identifier: Apache-2.0
#include "host/safety/read_back.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace vitreo {
namespace {

constexpr int kContradictions = 2;

}  // namespace

void ReadBack::set(Time at, std::span<const double> currents) {
  lately_.push_back({at, {currents.begin(), currents.end()}});
  forget_before(at);
}

void ReadBack::forget_before(Time at) {
  while (lately_.size() > 1 && lately_[1].at <= at - settling_) lately_.pop_front();
}

std::string ReadBack::judge(Time at, std::span<const double> measured) {
  std::vector<int> coils(measured.size());
  std::iota(coils.begin(), coils.end(), 0);
  return judge(at, measured, coils);
}

std::string ReadBack::judge(Time at, std::span<const double> measured, std::span<const int> coils) {
  forget_before(at);
  const std::string wrong = contradiction(measured, coils);
  contradicted_ = wrong.empty() ? 0 : contradicted_ + 1;
  return contradicted_ < kContradictions ? "" : wrong;
}

std::string ReadBack::contradiction(std::span<const double> measured,
                                    std::span<const int> coils) const {
  if (lately_.empty()) return "";
  const std::vector<double>& set = lately_.back().currents;
  for (std::size_t i = 0; i < std::min(measured.size(), coils.size()); ++i) {
    const auto coil = static_cast<std::size_t>(coils[i]);
    if (coil >= set.size()) continue;
    double low = set[coil], high = set[coil];
    for (const Set& one : lately_) {
      low = std::min(low, one.currents[coil]);
      high = std::max(high, one.currents[coil]);
    }
    // Negated, so that a NaN contradicts.
    if (!(measured[i] >= low - tolerance_ && measured[i] <= high + tolerance_))
      return fmt::format("coil {}: {:.3g} A flow where {:.3g} A were set", coil + 1, measured[i],
                         set[coil]);
  }
  return "";
}

}  // namespace vitreo
