// The simulated twin of a rig: the same roles, limits and settings, every instrument emulated; and
// what a script makes of it, for the dry run before anything is energized.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/open_rig.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// Whether something of the rig is a real instrument; recorded images and films are none.
bool is_laboratory(const RigDescription& rig);

/// The same rig with every address "emulated", a simulated camera in each real one's place, and a
/// pose sensor at the top camera's rate where the rig has none.
RigDescription twin_of(const RigDescription& rig);

/// Motion of one axis.
struct AxisUse {
  std::string role, axis, unit;  // "stage", "x", "m"
  int moves = 0;
  double min = 0, max = 0;  // of the places it was sent to
};

/// Opened on a clock, as open_rig() does, with a watch on whatever moves.
class Twin {
 public:
  Twin(const RigDescription& rig, Clock& clock, std::uint64_t seed);
  ~Twin();
  OpenRig& open_rig();
  /// Those that were moved, in the order of their roles.
  std::vector<AxisUse> moves() const;
  CoilUse coils() const;  // empty where the rig has none
  /// Releases a robot in the workspace's center, unless one is there.
  void bring_robot();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
