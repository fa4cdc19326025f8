// Sleep inhibitor: keeps the machine awake while something may be energized. A machine that is put
// to sleep freezes host and guardian alike, and an interface with a power supply of its own holds
// its outputs.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

namespace vitreo {

/// From construction to destruction, and no longer than this process lives. By systemd-inhibit;
/// where that is missing, or logind refuses, nothing inhibits: `vitreo doctor` tells.
class SleepInhibitor {
 public:
  SleepInhibitor();
  ~SleepInhibitor();
  SleepInhibitor(const SleepInhibitor&) = delete;
  SleepInhibitor& operator=(const SleepInhibitor&) = delete;

 private:
  int pipe_ = -1;  // its other end is the inhibitor's input: it leaves when this one is closed
  pid_t process_ = -1;
};

}  // namespace vitreo
