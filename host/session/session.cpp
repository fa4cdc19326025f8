// SPDX-License-Identifier: Apache-2.0
#include "host/session/session.h"

#include "host/files/log.h"
#include "host/session/background.h"

#include <exception>
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

SilenceActions Session::silence_actions() {
  return {[this](const std::string& name, AlarmPriority priority, const std::string& text) {
            raise(name, priority, text);
          },
          [this](const std::string& name) {
            alarms.clear(name);
            note_alarms();
          },
          [this](StopTier tier, const std::string& reason) { control.request(tier, reason); }};
}

void Session::reload(const std::string& role) {
  if (!rig.reload) throw std::invalid_argument("role: this rig has no instrument of a Lua file");
  instruments_.pause(role);
  std::exception_ptr failed;
  std::string event;
  try {
    const RigSource file = rig.reload(role);
    const std::string name = role + " reloaded " + std::to_string(++reloads_);
    recorder.module({name, file.file, file.text});
    event = role + " is read anew: " + name;
  } catch (const std::exception& error) {
    failed = std::current_exception();
    event = role + " could not be read anew: " + error.what();
  }
  instruments_.resume(role);
  recorder.event(clock.now(), "reload", event);
  if (failed) std::rethrow_exception(failed);
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
