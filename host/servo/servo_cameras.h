// Viewing systems of the servo loop besides the rig's own: a learnt background, the side camera's
// observations, trained colors.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/background.h"
#include "vision/multi_tracker.h"

#include <optional>
#include <vector>

namespace vitreo {

class SideObservationBuffer;

/// Learnt by Session::learn_background, or trained.
struct ServoCameras {
  std::optional<vision::Background> top;  // of the empty scene; not for the pose sensor
  SideObservationBuffer* side = nullptr;  // for two cameras
  /// For the eye by color: the robot first, then known bodies that it is not.
  std::vector<vision::TrackedObject> colors{};
};

}  // namespace vitreo
