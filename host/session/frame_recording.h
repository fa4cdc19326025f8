// Frame recording: decorators of a rig's cameras that put the frames they deliver into the record,
// so that what is recorded is what the loop saw.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// Which frames of a camera are kept.
struct FramePolicy {
  std::string camera;  // its role
  int every = 1;       // each n-th frame
  /// px: only a square window of that size about the robot, as the servo last saw it, of each n-th
  /// frame, as the camera NAME_window; and a whole frame each second. 0: whole frames.
  int window = 0;
  /// s: only what was taken so long before and after an event that matters: an alarm, an
  /// interlock's trip, a lost robot, an error, run:keep_frames. 0: all the time.
  double around = 0;
};
/// "top_camera/5@96~10": each fifth frame, 96 px about the robot, 10 s around events; each part may
/// be left out. Throws ConfigError naming the word.
FramePolicy parse_frame_policy(const std::string& word);
/// The kinds of events that "around events" means.
bool keeps_frames(const std::string& event_kind);

class FrameRecording {
 public:
  /// From now on rig.top_camera and rig.side_camera are decorators; the destructor puts the cameras
  /// back.
  FrameRecording(Clock& clock, Rig& rig, Recorder& recorder);
  ~FrameRecording();
  FrameRecording(const FrameRecording&) = delete;
  FrameRecording& operator=(const FrameRecording&) = delete;

  /// Records the frames that are grabbed from now on; while no caller grabs any, a task of its own
  /// does. Throws std::invalid_argument for a role that is no camera of this rig, or recorded
  /// already.
  void start(const FramePolicy& policy);
  /// Throws as start() does for a role that is no camera of this rig.
  void check(const FramePolicy& policy) const;
  /// Frames of cameras that no caller grabs are grabbed all the same, for the recorder's listener,
  /// as long as the session lasts.
  void watch();

 private:
  class Tap;
  Tap& tap_of(const FramePolicy& policy) const;
  Clock& clock_;
  Rig& rig_;
  Recorder& recorder_;
  std::vector<std::unique_ptr<Tap>> taps_;
  std::vector<std::unique_ptr<Task>> pumps_;  // they end before the taps
};

}  // namespace vitreo
