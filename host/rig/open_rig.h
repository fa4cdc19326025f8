// Opening of a rig file: instruments for the roles, the nominal model and, where something is
// simulated, the laboratory behind it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/link_tap.h"
#include "devices/sim/laboratory.h"
#include "devices/time/clock.h"
#include "host/config/config.h"
#include "host/rig/rig.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// A rig that is open. Destruction leaves the coils at zero.
class OpenRig {
 public:
  virtual ~OpenRig() = default;
  virtual Rig& rig() = 0;
  /// The rig as it was used, every default included.
  virtual const nlohmann::json& resolved() const = 0;
  /// Every device's safe action, each on its own; returns what failed. Idempotent.
  virtual std::vector<std::string> make_safe() = 0;
  /// Called, under the clock's baton, when the process that guards the outputs is gone; they are
  /// at zero by then, as far as their instruments answer.
  virtual void on_unguarded(std::function<void(const std::string&)> listener) = 0;
  /// The simulator, for its truth, its faults and for tests; null as soon as one role is real.
  /// Nothing of the loop is given it.
  virtual sim::Laboratory* laboratory() = 0;
};

/// What only tests set: see sim::LaboratorySettings.
struct SimulationShifts {
  // m
  Eigen::Vector3d truth{0, 0, 0};
  Eigen::Vector3d drawn{0, 0, 0};
};

/// Throws ConfigError for anything wrong in the description, DeviceError when an instrument does
/// not open. `tap` sees what passes on every link, and outlives the rig; null: none does.
std::unique_ptr<OpenRig> open_rig(const RigDescription& description, Clock& clock,
                                  std::uint64_t seed, const SimulationShifts& shifts = {},
                                  LinkTap* tap = nullptr);

}  // namespace vitreo
