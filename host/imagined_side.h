// What stands for the side camera in a rehearsal, where nobody looks through cameras: its stream, from the truth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"
#include "devices/sim/laboratory.h"
#include "host/recorder.h"

#include <memory>
#include <string>

namespace vitreo {

/// "side_camera": x and z in m, the ellipse's axes in px.
StreamInfo side_stream(const std::string& source);

/// Records that stream while a robot is there, each `period` s; the axes are not numbers. `laboratory` outlives the
/// task.
std::unique_ptr<Task> imagine_side(Clock& clock, sim::Laboratory& laboratory, double period, Recorder& recorder);

}  // namespace vitreo
