// SPDX-License-Identifier: Apache-2.0
#include "host/session/session.h"

#include "host/files/log.h"
#include "host/session/background.h"

#include <stdexcept>
#include <string>

namespace vitreo {

// Latched first and then drained at once, so that the event stands in the record before whatever
// the caller does next.
void Session::raise(const std::string& name, AlarmPriority priority, const std::string& text) {
  alarms.raise(name, priority, text);
  note_alarms();
}

// The recorder belongs to the thread with the baton; alarms raised or acknowledged elsewhere wait
// in their queue until this is called there. A rehearsal writes no log.
void Session::note_alarms() {
  for (const Event& event : alarms.drain_events()) {
    recorder.event(event.time, event.kind, event.text);
    if (event.kind == "alarm") listener.message("ALARM " + event.text);
    if (rehearsal == nullptr) write_log(event.kind + ": " + event.text);
  }
}

vision::Background Session::learn_background(int count) {
  if (rig.top_camera == nullptr)
    throw std::invalid_argument("learn_background needs the role top_camera");
  const Time from = clock.now();
  vision::Background top = vitreo::learn_background(*rig.top_camera, count, from);
  // For a replay: which of the recorded frames they were.
  recorder.event(
      clock.now(), "background",
      nlohmann::json{{"camera", "top_camera"}, {"from_ns", from.count()}, {"count", count}}.dump());
  // Once is enough for the side: a second learning during a run keeps the observer that is there.
  // In a rehearsal poses stand in for images, and its record is thrown away.
  if (rig.side_camera != nullptr && !side_observations_ && rehearsal == nullptr) {
    vision::Background side = vitreo::learn_background(*rig.side_camera, count, clock.now());
    side_observations_ = std::make_unique<SideObservationBuffer>(
        clock, from_seconds(rig.side_camera->info().frame_period));
    keep(observe_side(clock, rig, std::move(side), recorder, *side_observations_));
  }
  return top;
}

}  // namespace vitreo
