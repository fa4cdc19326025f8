// Read-back of the coils' currents: what is measured against what was set lately.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <deque>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

class ReadBack {
 public:
  /// `tolerance` in A, by which a current may be outside of what was set within `settling`, in
  /// which it follows its set-point.
  explicit ReadBack(double tolerance, Time settling = std::chrono::milliseconds(150))
      : tolerance_(tolerance), settling_(settling) {}
  /// A set-point that was taken, A.
  void set(Time at, std::span<const double> currents);
  /// What contradicts it, twice in a row: a step's own transient does so once at most. Empty where
  /// nothing does, and before the first set-point.
  std::string judge(Time at, std::span<const double> measured);
  /// The same of a sensor that measures these coils, counted from 0.
  std::string judge(Time at, std::span<const double> measured, std::span<const int> coils);
  /// Whether the last reading contradicted, so that the next one decides.
  bool doubted() const { return contradicted_ > 0; }

 private:
  std::string contradiction(std::span<const double> measured, std::span<const int> coils) const;
  void forget_before(Time at);

  struct Set {
    Time at{};
    std::vector<double> currents;
  };
  const double tolerance_;
  const Time settling_;
  std::deque<Set> lately_;  // within the settling time, and the last before
  int contradicted_ = 0;    // in a row
};

}  // namespace vitreo
