// Current watch: compares what a current sensor measures with what was set, while a current flows.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/current_sensor.h"
#include "devices/time/clock.h"
#include "host/safety/read_back.h"

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

struct CurrentWatchSettings {
  double tolerance = 0.25;  // A, by which a current may be outside of what was set lately
  double settling = 0.15;   // s, within which a current follows its set-point
  double period = 0.05;     // s, between the beginnings of two measurements
  double timeout = 0.5;     // s, of one
  void check() const;       // throws std::invalid_argument naming the setting
};

/// A task of the run's clock. It rests while nothing is energized.
class CurrentWatch {
 public:
  /// `energized`: whether a current flows. `failed`: what contradicts the set-points, or why
  /// nothing can be measured. Neither throws; sensor and clock outlive this.
  CurrentWatch(CurrentSensor& sensor, const CurrentWatchSettings& settings, Clock& clock,
               std::function<bool()> energized, std::function<void(std::string)> failed);
  /// A set-point that was taken, A, one a coil.
  void set(Time at, std::span<const double> currents);
  /// A, in the order of coils(). Throws DeviceError.
  std::vector<double> measure() { return sensor_.measure(timeout_); }
  const std::vector<int>& coils() const { return sensor_.info().coils; }

 private:
  void run();
  void look();

  CurrentSensor& sensor_;
  const Time period_;
  const Time timeout_;
  Clock& clock_;
  const std::function<bool()> energized_;
  const std::function<void(std::string)> failed_;
  ReadBack read_back_;
  Signal changed_;
  std::unique_ptr<Task> task_;  // last: it uses the others
};

}  // namespace vitreo
