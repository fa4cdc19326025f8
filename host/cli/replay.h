// Replay: a recorded run's frames through today's tracker and localizer, compared with then.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"
#include "host/rig/rig.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <vector>

namespace vitreo {

struct ReplayedFrame {
  std::uint64_t number = 0;
  Time exposed{};
  // m, world: where the robot was seen.
  std::optional<Eigen::Vector3d> recorded;
  std::optional<Eigen::Vector3d> replayed;
};

struct ReplayStatistics {
  std::size_t frames = 0;
  std::size_t compared = 0;  // seen then and now
  std::size_t same = 0;      // of those, to the bit
  std::size_t only_recorded = 0;
  std::size_t only_replayed = 0;
  // m, of the distance.
  double rms = 0;
  double mean = 0;
  double max = 0;
};

struct Replay {
  std::vector<ReplayedFrame> frames;  // those that the servo loop worked on
  std::size_t background_frames = 0;
  Eigen::Vector3d axis{1, 0, 0};
  bool axis_known = false;  // the record names it; else it is the servo's default
  ReplayStatistics statistics() const;
};

/// `model`: what the loop computes with. Throws RecordError saying what the run lacks: frames of
/// the top camera, those of the background, or the stream "servo".
Replay replay(const RunData& data, const RigModel& model);

}  // namespace vitreo
