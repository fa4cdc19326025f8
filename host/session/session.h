// What a script works with during one run (or one prompt): the clock, the rig, the record, all
// borrowed; built and torn down in host/engine/conduct.cpp.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/observers.h"
#include "host/session/alarms.h"
#include "host/session/frame_recording.h"
#include "host/session/operator_desk.h"
#include "host/session/operator_targets.h"
#include "host/session/questions.h"
#include "host/session/run_control.h"
#include "vision/background.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

class FaultDesk;

/// How far a run is, told to whoever shows it.
class ProgressListener {
 public:
  virtual ~ProgressListener() = default;
  /// `fraction` of the whole in [0, 1]; `label` says what is being done.
  virtual void progress(double fraction, const std::string& label) = 0;
  virtual void message(const std::string& line) = 0;  // print() and run:note()
  /// Shows a question; then, again and again, what the operator has typed meanwhile, a line at
  /// most.
  virtual void question(const Question& asked) { message(shown(asked)); }
  virtual std::optional<std::string> typed() { return std::nullopt; }
};

/// Statistics of one recorded stream against another, both holding x, y, z in m; sampled where both
/// have the same time. Where one has no y (a side view), y is not compared.
struct ErrorStatistics {
  std::size_t count = 0;
  double rms = 0, mean = 0, max = 0;      // m, in 3-D
  double lateral_rms = 0, depth_rms = 0;  // m: x and y; z
  double lateral_mean = 0, depth_mean = 0, lateral_max = 0, depth_max = 0, lateral_std = 0;
  double depth_std = 0;  // m: of |error|
};
/// `stream` and `channels` such as "truth" and "servo", with the names of the three channels'
/// prefix: "" for x, y, z or "target_" for target_x ... Throws std::invalid_argument naming what is
/// missing.
ErrorStatistics error_statistics(const Recorder& recorder, const std::string& stream,
                                 const std::string& prefix, const std::string& reference,
                                 const std::string& reference_prefix, Time from, Time to);

/// Learns the background from `frames` images exposed at `from` or later: what was on its way
/// before shows an older scene. Blocks on the clock. Throws std::invalid_argument for fewer than 2
/// frames or more than 1000, DeviceError.
vision::Background learn_background(Camera& camera, int frames, Time from);

/// What a dry run does in the world's place, and what it hears: nobody is there to answer, and
/// poses stand in for images where they can.
struct Rehearsal {
  std::function<void()> bring_robot;  // a rig without a sample handler: the operator's hands
  bool pose_sensor = false;           // the rig has one of its own
  std::vector<FramePolicy> frames;    // whose recording the script asked for
  std::vector<std::string> remarks;   // what could not be played as it will be
};

/// Destroyed before the clock, the rig and the recorder that it borrows.
class Session {
 public:
  Session(Clock& a_clock, Rig& a_rig, Recorder& a_recorder, ProgressListener& a_listener,
          std::uint64_t a_seed)
      : clock(a_clock),
        rig(a_rig),
        recorder(a_recorder),
        listener(a_listener),
        seed(a_seed),
        alarms(a_clock),
        frames(a_clock, a_rig, a_recorder) {
    recorder.on_alarm([this](const std::string& name, AlarmPriority priority,
                             const std::string& text) { raise(name, priority, text); });
  }
  ~Session() { recorder.on_alarm({}); }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  Clock& clock;
  Rig& rig;
  Recorder& recorder;
  ProgressListener& listener;
  const std::uint64_t seed;
  bool real_time = false;  // the clock keeps the wall clock's pace; else it stands still while
                           // people are waited for
  RunControl control;
  Questions questions;
  Alarms alarms;
  Rehearsal* rehearsal = nullptr;  // a dry run; null in a real one
  OperatorTargets targets;
  OperatorDesk desk{control, questions, alarms, targets};  // commands from outside
  FrameRecording frames;        // the observers, which use its cameras, end before it
  FaultDesk* faults = nullptr;  // breaks simulated instruments (host/session/faults.h); null where
                                // nothing is simulated

  /// Learns what the empty scene looks like, for the top camera (returned) and, when there is one,
  /// for the side camera, whose estimate is recorded from then on. Blocks on the clock. Throws
  /// DeviceError, std::invalid_argument.
  vision::Background learn_background(int count);
  /// Raises an alarm, records it and shows it. On the script's thread, or with the clock's baton.
  void raise(const std::string& name, AlarmPriority priority, const std::string& text);
  /// What was done to alarms elsewhere, such as at the control socket, goes into the record.
  void note_alarms();
  /// Keeps a task that watches the run until the session ends.
  void keep(std::unique_ptr<Task> observer) { observers_.push_back(std::move(observer)); }
  /// What the side camera sees; null before a background was learnt, and without a side camera.
  SideObservationBuffer* side_observations() { return side_observations_.get(); }

 private:
  std::unique_ptr<SideObservationBuffer> side_observations_;  // before the observers that use it
  std::vector<std::unique_ptr<Task>> observers_;
};

}  // namespace vitreo
