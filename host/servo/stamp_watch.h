// Stamp watch: a camera's time stamps held against the arrival of its frames and their numbers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"

#include <optional>
#include <string>

namespace vitreo {

/// A clock that is set, drifts or fails moves the stamps where neither arrivals nor numbers move: a
/// frame that is really late has the stamp that its number wants, and one of a camera that exposes
/// when it likes has the stamp that its arrival wants.
class StampWatch {
 public:
  /// `period`: s, between exposures, as the camera says; 0: unknown, then only the future is told.
  explicit StampWatch(double period) : period_(period) {}
  /// Why the stamp of this frame cannot be true; empty where it can. A frame that is judged so is
  /// not remembered.
  std::string fault(const Frame& frame, Time now);

 private:
  struct Stamp {
    Time exposed{};
    Time received{};
    std::uint64_t number = 0;
  };
  /// s, by which the stamp has moved since `then`; 0 where arrivals or numbers say as much.
  double moved(const Stamp& then, const Stamp& now, double allowed) const;

  double period_;
  std::optional<Stamp> first_;   // of all
  std::optional<Stamp> anchor_;  // of the seconds before
  std::optional<Stamp> next_;    // of these seconds
};

}  // namespace vitreo
