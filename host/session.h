// What a script works with during one run (or one prompt): the clock, the rig, the record. Owns none of them but the servo's
// life; host/run_engine builds and tears it down in one place.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <string>

#include "devices/clock.h"
#include "host/recorder.h"
#include "host/rig.h"
#include "vision/background.h"

namespace vitreo {

/// How far a run is, told to whoever shows it.
class ProgressListener {
 public:
  virtual ~ProgressListener() = default;
  /// `fraction` of the whole in [0, 1]; `label` says what is being done.
  virtual void progress(double fraction, const std::string& label) = 0;
  virtual void message(const std::string& line) = 0;  // print() and run:note()
};

/// Statistics of one recorded stream against another, both holding x, y, z in m; sampled where both have the same time.
struct ErrorStatistics {
  std::size_t count = 0;
  double rms = 0, mean = 0, max = 0;                  // m, in 3-D
  double lateral_rms = 0, depth_rms = 0;              // m: x and y; z
  double lateral_mean = 0, depth_mean = 0, lateral_max = 0, depth_max = 0, lateral_std = 0, depth_std = 0;  // of |error|
};
/// `stream` and `channels` such as "truth" and "servo", with the names of the three channels' prefix: "" for x, y, z or
/// "target_" for target_x ... Throws std::invalid_argument naming what is missing.
ErrorStatistics error_statistics(const Recorder& recorder, const std::string& stream, const std::string& prefix,
                                 const std::string& reference, const std::string& reference_prefix, Time from, Time to);

/// Learns the background from `frames` images. Blocks on the clock.
vision::Background learn_background(Camera& camera, int frames);

class Session {
 public:
  Session(Clock& clock, Rig& rig, Recorder& recorder, ProgressListener& listener, std::uint64_t seed)
      : clock(clock), rig(rig), recorder(recorder), listener(listener), seed(seed) {}
  Clock& clock;
  Rig& rig;
  Recorder& recorder;
  ProgressListener& listener;
  const std::uint64_t seed;
};

}  // namespace vitreo
