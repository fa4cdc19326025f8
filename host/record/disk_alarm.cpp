// SPDX-License-Identifier: Apache-2.0
#include "host/record/disk_alarm.h"

namespace vitreo {

// DiskWatch's warning begins with "the disk" and needs an answer by the operator; back pressure and
// drops do not.
DiskAlarm::DiskAlarm(const std::string& said)
    : name(said.starts_with("the disk") ? kDiskAlarm : kRecordingAlarm),
      priority(name == kDiskAlarm ? AlarmPriority::medium : AlarmPriority::low),
      text(said) {}

bool is_disk_alarm(const Event& event) {
  if (event.kind != "alarm") return false;
  for (const AlarmPriority priority :
       {AlarmPriority::low, AlarmPriority::medium, AlarmPriority::high})
    for (const char* name : {kDiskAlarm, kRecordingAlarm})
      if (event.text.starts_with(alarm_text(priority, name, ""))) return true;
  return false;
}

}  // namespace vitreo
