// Tasks that watch a run for its record: the simulator's truth, and the side camera's estimate. The loop knows neither.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/camera.h"
#include "devices/clock.h"
#include "devices/sim/laboratory.h"
#include "host/recorder.h"
#include "host/rig.h"
#include "vision/background.h"

#include <memory>

namespace vitreo {

/// Records the stream "truth" at the top camera's exposures while a robot is in the eye.
std::unique_ptr<Task> observe_truth(Clock& clock, sim::Laboratory& laboratory, double period, Recorder& recorder);

/// Records the stream "side_camera" (x and z) from the side camera's own frames. `background` of the empty scene.
std::unique_ptr<Task> observe_side(Clock& clock, Rig& rig, vision::Background background, Recorder& recorder);

}  // namespace vitreo
