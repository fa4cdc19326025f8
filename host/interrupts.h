// Ctrl-C and SIGTERM: the first asks the run to stop, which unwinds the script and makes the devices safe.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"
#include "host/script_engine.h"

namespace vitreo {

/// While it lives, SIGINT, SIGTERM and SIGHUP stop the run: its current wait, or its script where that does not wait. A
/// third one ends the process at once. One at a time.
class InterruptScope {
 public:
  InterruptScope(Clock& clock, ScriptEngine& engine);
  ~InterruptScope();
  InterruptScope(const InterruptScope&) = delete;
  InterruptScope& operator=(const InterruptScope&) = delete;
};

}  // namespace vitreo
