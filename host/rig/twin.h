// Simulated twin of a rig: the same roles, limits and settings with every instrument emulated, and
// a meter of what a script does with them, for the dry run before anything is energized.
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
  // "stage", "x", "m"
  std::string role;
  std::string axis;
  std::string unit;
  int moves = 0;
  // of the places it was sent to
  double min = 0;
  double max = 0;
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
