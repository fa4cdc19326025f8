// Physical constants of the control library. For its sources only.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <numbers>

namespace vitreo::control {

constexpr double kPi = std::numbers::pi;
/// Vacuum permeability, T m/A: exact until 2019, to 1e-9 since.
constexpr double kMu0 = 4e-7 * kPi;
constexpr double kMu0Over4Pi = 1e-7;  // T m/A

}  // namespace vitreo::control
