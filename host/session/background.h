// Background learning: the empty scene of a camera, from images taken on the run's clock.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"
#include "vision/background.h"

namespace vitreo {

/// Learns the background from `frames` images exposed at `from` or later: what was on its way
/// before shows an older scene. Blocks on the clock. Throws std::invalid_argument for fewer than 2
/// frames or more than 1000, DeviceError.
vision::Background learn_background(Camera& camera, int frames, Time from);

}  // namespace vitreo
