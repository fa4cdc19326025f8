// Session: the objects that a script works with during one run (or one prompt): the clock, the rig,
// the record, all borrowed; built and torn down in host/engine/conduct.cpp.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/observers.h"
#include "host/session/alarms.h"
#include "host/session/frame_recording.h"
#include "host/session/instrument_record.h"
#include "host/session/operator_desk.h"
#include "host/session/operator_targets.h"
#include "host/session/progress_listener.h"
#include "host/session/questions.h"
#include "host/session/run_control.h"
#include "host/session/run_facts.h"
#include "vision/background.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

class FaultInjector;

/// Substitutes of a dry run for the operator's hands and the cameras, and what it found: no
/// operator answers, and poses stand in for images where they can.
struct Rehearsal {
  std::function<void()> bring_robot;   // of a rig without a sample handler: the operator's hands
  bool pose_sensor = false;            // the rig has one of its own
  std::vector<FramePolicy> frames;     // whose recording the script asked for
  std::vector<std::string> remarks;    // differences between the dry run and the run to come
  std::set<std::string> loop_sources;  // roles by whose measurements servo loops turned
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
        frames(a_clock, a_rig, a_recorder),
        instruments_(a_clock, a_rig, a_recorder, silence_actions()) {
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
  /// The clock keeps the wall clock's pace; else it stands still while an operator is waited for.
  bool real_time = false;
  RunControl control;
  RunFacts facts{recorder};
  Questions questions;
  Alarms alarms;
  Rehearsal* rehearsal = nullptr;  // a dry run; null in a real one
  OperatorTargets targets;
  OperatorDesk desk{control, questions, alarms, targets};  // commands from outside
  FrameRecording frames;  // the observers, which use its cameras, end before it
  /// Breaks simulated instruments (host/session/faults.h); null where nothing is simulated.
  FaultInjector* faults = nullptr;

  /// Learns the empty scene (host/session/background.h) for the top camera (returned) and, when
  /// there is one, for the side camera, whose estimate is recorded from then on. Blocks on the
  /// clock. Throws DeviceError, std::invalid_argument.
  vision::Background learn_background(int count);
  /// Raises an alarm, records it and shows it. On the script's thread, or with the clock's baton.
  void raise(const std::string& name, AlarmPriority priority, const std::string& text);
  /// Reads the Lua file of a role's instrument anew (Rig::reload); the record keeps what it says
  /// now, and goes on with what it asks for by itself. Throws as Rig::reload() does.
  void reload(const std::string& role);
  /// Records what was done to alarms elsewhere, such as at the control socket.
  void note_alarms();
  /// Keeps a task that watches the run until the session ends.
  void keep(std::unique_ptr<Task> observer) { observers_.push_back(std::move(observer)); }
  /// The side camera's observations; null before a background was learnt, and without a side
  /// camera.
  SideObservationBuffer* side_observations() { return side_observations_.get(); }

 private:
  SilenceActions silence_actions();
  InstrumentRecord instruments_;
  int reloads_ = 0;
  std::unique_ptr<SideObservationBuffer> side_observations_;  // before the observers that use it
  std::vector<std::unique_ptr<Task>> observers_;
};

}  // namespace vitreo
