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

void Alarms::note(const std::string& kind, const std::string& text) {
  events_.push_back({clock_.now(), kind, text});
  ++changes_;
}

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
  if (!alarm.active || priority > alarm.priority) alarm.acknowledged_by.clear();
  const bool news = !alarm.active || text != alarm.text || priority != alarm.priority;
  alarm.priority = std::max(alarm.priority, priority);
  alarm.text = text;
  alarm.active = true;
  ++alarm.times;
  if (news) note("alarm", to_string(alarm));
}

void Alarms::clear(const std::string& name) {
  const std::lock_guard lock(mutex_);
  for (Held& held : held_) {
    if (!held.latched || held.alarm.name != name || !held.alarm.active) continue;
    held.alarm.active = false;
    held.latched = held.alarm.acknowledged_by.empty();
    note("alarm cleared", name);
  }
}

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
    held.latched = held.alarm.active;
    note("alarm acknowledged", held.alarm.name + " (" + by + ")");
    ++count;
  }
  if (count == 0 && !name.empty())
    throw std::invalid_argument("no alarm '" + name + "' stands" +
                                (names.empty() ? "" : "; there is: " + names));
  return count;
}

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

std::vector<Event> Alarms::take_events() {
  const std::lock_guard lock(mutex_);
  return std::exchange(events_, {});
}

}  // namespace vitreo
