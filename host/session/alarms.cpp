// SPDX-License-Identifier: Apache-2.0
#include "host/session/alarms.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace vitreo {

std::string to_string(const Alarm& alarm) {
  return alarm_text(alarm.priority, alarm.name, alarm.text);
}

Alarms::Alarms(const Clock& clock, Now wall) : clock_(clock), wall_(std::move(wall)) {}

// With the lock held. `changes_` is what faces poll (OperatorDesk::changes).
void Alarms::note(const std::string& kind, const std::string& text) {
  events_.push_back({clock_.now(), kind, text});
  ++changes_;
}

/// An alarm is one entry from its first raise() until its cause is gone and it is acknowledged; a
/// later one of that name is a new entry, so that history() has both.
void Alarms::raise(const std::string& name, AlarmPriority priority, const std::string& text) {
  const std::lock_guard lock(mutex_);
  const auto found = std::find_if(held_.begin(), held_.end(), [&](const Held& held) {
    return held.latched && held.alarm.name == name;
  });
  if (found == held_.end()) {
    held_.push_back({{name, priority, text, clock_.now(), true, 1, ""}, {}, true});
    return note("alarm", to_string(held_.back().alarm));
  }
  Alarm& alarm = found->alarm;
  // An acknowledgement is of what was known then: it does not cover a cause that came back or grew.
  if (!alarm.active || priority > alarm.priority) alarm.acknowledged_by.clear();
  // A cause that is raised at each tick of a loop is one event of the record, not thousands.
  const bool news = !alarm.active || text != alarm.text || priority != alarm.priority;
  alarm.priority = std::max(alarm.priority, priority);
  alarm.text = text;
  alarm.active = true;
  ++alarm.times;
  if (news) note("alarm", to_string(alarm));
}

// By the cause's own watcher; an operator acknowledges instead. Without a latched alarm of that
// name nothing happens, so a watcher may call it at every turn.
void Alarms::clear(const std::string& name) {
  const std::lock_guard lock(mutex_);
  for (Held& held : held_) {
    if (!held.latched || held.alarm.name != name || !held.alarm.active) continue;
    held.alarm.active = false;
    // Latching (IEC 60601-1-8): a cause that came and went is still shown until it is acknowledged.
    held.latched = held.alarm.acknowledged_by.empty();
    note("alarm cleared", name);
  }
}

// The names that stand are collected on the way, for the message to a person who misspelt one.
int Alarms::acknowledge(const std::string& name, const std::string& by) {
  const std::lock_guard lock(mutex_);
  int count = 0;
  std::string names;
  for (Held& held : held_) {
    if (!held.latched) continue;
    names += (names.empty() ? "" : ", ") + held.alarm.name;
    if (!name.empty() && held.alarm.name != name) continue;
    held.alarm.acknowledged_by = by;
    held.acknowledged_at = wall_();
    // With its cause gone it goes; else it is silent for kSilence, see as_shown().
    held.latched = held.alarm.active;
    note("alarm acknowledged", held.alarm.name + " (" + by + ")");
    ++count;
  }
  if (count == 0 && !name.empty())
    throw std::invalid_argument("no alarm '" + name + "' stands" +
                                (names.empty() ? "" : "; there is: " + names));
  return count;
}

/// The alarm as it is displayed now: the silence of a cause that is still there expires.
Alarm Alarms::as_shown(const Held& held) const {
  Alarm alarm = held.alarm;
  if (alarm.active && wall_() - held.acknowledged_at > kSilence) alarm.acknowledged_by.clear();
  return alarm;
}

std::vector<Alarm> Alarms::shown() const {
  const std::lock_guard lock(mutex_);
  std::vector<Alarm> alarms;
  for (const Held& held : held_)
    if (held.latched) alarms.push_back(as_shown(held));
  // Stable: within a priority the order of raising stays, the oldest first.
  std::stable_sort(alarms.begin(), alarms.end(),
                   [](const Alarm& a, const Alarm& b) { return a.priority > b.priority; });
  return alarms;
}

bool Alarms::anything_unacknowledged() const {
  const std::lock_guard lock(mutex_);
  return std::any_of(held_.begin(), held_.end(), [this](const Held& held) {
    return held.latched && as_shown(held).acknowledged_by.empty();
  });
}

std::vector<Alarm> Alarms::history() const {
  const std::lock_guard lock(mutex_);
  std::vector<Alarm> alarms;
  for (const Held& held : held_) alarms.push_back(held.alarm);
  return alarms;
}

std::vector<Event> Alarms::drain_events() {
  const std::lock_guard lock(mutex_);
  return std::exchange(events_, {});
}

}  // namespace vitreo
