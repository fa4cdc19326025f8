// Puts the frames of a rig's cameras into the record: it stands between the cameras and whoever uses them, so what is
// recorded is what the loop saw.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"
#include "host/recorder.h"
#include "host/rig.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// "top_camera" or "top_camera/5": which role, each n-th frame.
struct FramePolicy {
  std::string camera;
  int every = 1;
};
/// Throws ConfigError naming the word.
FramePolicy parse_frame_policy(const std::string& word);

class FrameRecording {
 public:
  /// From now on rig.top_camera and rig.side_camera are decorators; the destructor puts the cameras back.
  FrameRecording(Clock& clock, Rig& rig, Recorder& recorder);
  ~FrameRecording();
  FrameRecording(const FrameRecording&) = delete;
  FrameRecording& operator=(const FrameRecording&) = delete;

  /// Records each `every`-th frame that somebody takes from now on; while nobody does, a task of its own takes them.
  /// std::invalid_argument for a role that is no camera of this rig, or recorded already.
  void start(const FramePolicy& policy);

 private:
  class Tap;
  Clock& clock_;
  Rig& rig_;
  Recorder& recorder_;
  std::vector<std::unique_ptr<Tap>> taps_;
  std::vector<std::unique_ptr<Task>> pumps_;  // they end before the taps
};

}  // namespace vitreo
