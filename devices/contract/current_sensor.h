// Contract suite of CurrentSensor: the duties of the role, checked alike on emulators and real
// instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/current_sensor.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::contract {

struct CurrentSensorCheck {
  Time timeout = std::chrono::seconds(5);  ///< of each measurement
  /// A, in the order of info().coils, where what flows can be known; else null.
  std::function<std::vector<double>()> really{};
  double tolerance = 0.05;  ///< A
};

/// Measures; returns one sentence for each duty that it fails. Lets Stopped pass.
std::vector<std::string> check(CurrentSensor& sensor, const CurrentSensorCheck& how = {});

}  // namespace vitreo::contract
