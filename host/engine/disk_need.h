// Disk need: the space on the disk that a run will want, estimated before it begins.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/session/frame_recording.h"

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

/// Of gray frames at the cameras' own rate; a color camera's are three times that.
double frame_bytes_per_second(const std::vector<FramePolicy>& policies, const Rig& rig);
/// Of what stands in a record's streams, as SQLite keeps it.
double sample_bytes(const Recorder& recorder);

/// Bytes that are free where a run's folder would be made, also when `out` is not there yet.
double free_bytes_for(const std::filesystem::path& out);
/// Empty where there is room for 1.2 times `need` beside what must be left for a run to begin and
/// to go on, with or without `frames` (DiskLimits); else one line.
std::string disk_problem(const std::filesystem::path& out, double need, bool frames);
/// Empty where frames of that many bytes a second can be recorded for 10 minutes; else one line
/// that says for how long.
std::string disk_warning(const std::filesystem::path& out, double bytes_per_second);

}  // namespace vitreo
