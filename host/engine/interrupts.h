// Ctrl-C and SIGTERM: the first stops the run, the second aborts it, the third ends the process.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo {

class RunControl;

/// While it lives, SIGINT, SIGTERM and SIGHUP are requests to the run: stop, then abort; one more
/// ends the process at once. SIGQUIT is an abort. No signal ends the process while a record is
/// being closed. One scope lives at a time.
class InterruptScope {
 public:
  InterruptScope();
  ~InterruptScope();
  InterruptScope(const InterruptScope&) = delete;
  InterruptScope& operator=(const InterruptScope&) = delete;
  /// The run of `control`, which is attached, can be stopped from now on. Signals that have come
  /// since the scope began are its first requests.
  void begin(RunControl& control);
  /// The run has ended, and its record is being closed: a signal is too late from now on.
  void end() noexcept;
};

}  // namespace vitreo
