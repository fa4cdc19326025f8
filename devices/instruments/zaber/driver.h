// Driver of Zaber's stages by their ASCII protocol, linear and rotary: X-series devices in a chain,
// and A-series stages behind a controller.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "devices/time/clock.h"

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::zaber {

struct AxisSettings {
  std::string name = "z";
  int device = 1;  ///< its number in the chain, 1 to 99
  int axis = 1;    ///< 1 to 9: of a controller with several
  /// m or rad per full step, from the data sheet (X-LSM: 3.048 um; 64 microsteps).
  double step = 3.048e-6;
  /// m or rad from the home end; the instrument's own limits hold as well.
  double travel_min = -std::numeric_limits<double>::infinity();
  double travel_max = std::numeric_limits<double>::infinity();
  double max_speed = 10e-3;        ///< m/s or rad/s
  double speed = 2e-3;             ///< m/s or rad/s
  std::optional<int> device_id{};  ///< that the instrument must report; else any is accepted
};

struct Settings {
  std::string name = "stage";  ///< in errors
  std::vector<AxisSettings> axes{AxisSettings{}};
  double reply_timeout = 0.5;  ///< s
  void check() const;          ///< throws std::invalid_argument naming the setting
};

/// Opens the devices: identity, limits and speeds read and checked, checksums on, alerts off; what
/// moved is stopped, nothing is set moving. Throws DeviceError. Destruction stops it. An axis that
/// has lost its reference refuses to move until home(). After DeviceError{lost} the next call opens
/// it anew, and what was set off is dropped.
std::unique_ptr<Stage> open(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock);

/// The same for one axis that turns; a step is in rad.
std::unique_ptr<RotationStage> open_rotary(std::unique_ptr<ByteLink> link, const Settings& settings,
                                           Clock& clock);

}  // namespace vitreo::zaber
