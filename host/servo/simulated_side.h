// Simulated side camera of a dry run, which renders no images: its stream, from the truth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"

#include <memory>
#include <string>

namespace vitreo {

/// "side_camera": x and z in m, the ellipse's axes in px.
StreamInfo side_stream(const std::string& source);

/// Records that stream while a robot is there, each `period` s; the axes are not numbers.
/// `laboratory` outlives the task.
std::unique_ptr<Task> simulate_side(Clock& clock, sim::Laboratory& laboratory, double period,
                                    Recorder& recorder);

}  // namespace vitreo
