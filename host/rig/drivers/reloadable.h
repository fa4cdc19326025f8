// Reloadable drivers: proxies of the roles that a Lua file can play, whose driver is exchanged
// under those who hold them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/registry.h"

#include <functional>
#include <string>

namespace vitreo {

/// A driver's file as it was read.
template <class Role>
struct DriverReading {
  Opener<Role> opener;
  RigSource file{};
  bool has_safe_state = false;  ///< it may heat, drive or switch something
};

template <class Role>
struct ReloadableDriver {
  std::string role;
  DriverReading<Role> first;
  /// Reads the file anew: throws ConfigError where that cannot be.
  std::function<DriverReading<Role>()> again;
};

/// Opens it as it was read first, and enters its proxy into where.reloadable. The proxy's info() is
/// its own, so references to it hold until the next reload. Throws DeviceError.
template <class Role>
Opened<Role> open_reloadable(ReloadableDriver<Role> driver, const RigContext& where);

}  // namespace vitreo
