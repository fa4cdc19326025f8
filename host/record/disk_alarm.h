// Alarms of the disk that takes the record: their names and priorities.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <string>

namespace vitreo {

inline constexpr const char* kDiskAlarm = "disk";            // it fills
inline constexpr const char* kRecordingAlarm = "recording";  // it is behind

/// `text` of the record writer as an alarm.
struct DiskAlarm {
  explicit DiskAlarm(const std::string& text);
  const char* name;
  AlarmPriority priority;
  std::string text;
};

/// Whether the event is an alarm of one of the two names: such times are the machine's, other in
/// every run of a seed.
bool is_disk_alarm(const Event& event);

}  // namespace vitreo
