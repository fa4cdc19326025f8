// Observers: tasks that record the simulator's truth, which the loop never knows, and the side
// camera's estimate, which a loop with two cameras asks for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/sim/laboratory.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/servo/side_observation.h"
#include "vision/background.h"

#include <deque>
#include <memory>
#include <optional>

namespace vitreo {

/// The event "machine": what was drawn of the simulated machine, as JSON. Truth, for the record
/// alone.
void record_machine(Recorder& recorder, Time now, const sim::Laboratory& laboratory);

/// Records the event "machine" whenever another is drawn, and the stream "truth" at the top
/// camera's exposures while a robot is in the eye.
std::unique_ptr<Task> observe_truth(Clock& clock, sim::Laboratory& laboratory, double period,
                                    Recorder& recorder);

/// Records the interlock's estimate of the coils' temperatures each 0.5 s, as the stream
/// "coil_temperature"; null where it has none.
std::unique_ptr<Task> observe_coil_temperatures(Clock& clock, Interlock& coils, Recorder& recorder);

/// The side camera's latest observations: its observer alone takes that camera's frames, and a loop
/// asks here for the one of a moment.
class SideObservationBuffer {
 public:
  /// `period` of the side camera's frames.
  SideObservationBuffer(Clock& clock, Time period) : clock_(clock), period_(period) {}
  void add(const Frame& frame, std::optional<SideObservation> seen);
  /// The view at the moment `exposed`, waiting until `deadline`: of the frame of that moment, where
  /// the cameras are in step (to 1 ms); else on the line through the two nearest frames in which
  /// the robot was seen, one of which may be yet to come: a robot that moves at 1 mm/s is elsewhere
  /// by 30 um after half a period. Nothing when there are no two within three periods of each
  /// other.
  std::optional<SideObservation> at(Time exposed, Time deadline);

 private:
  struct Entry {
    Time exposed;
    std::optional<SideObservation> seen;
  };
  std::optional<SideObservation> between(Time exposed) const;

  Clock& clock_;
  const Time period_;
  Signal added_;
  std::deque<Entry> lately_;
};

/// Records the stream "side_camera" (x and z) from the side camera's own frames and adds them to
/// `watch`, which must outlive the task. `background` of the empty scene.
std::unique_ptr<Task> observe_side(Clock& clock, Rig& rig, vision::Background background,
                                   Recorder& recorder, SideObservationBuffer& watch);

}  // namespace vitreo
