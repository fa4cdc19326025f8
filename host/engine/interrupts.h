// Ctrl-C and SIGTERM: the first stops the run, the second aborts it, the third ends the process.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo {

/// While it lives, SIGINT, SIGTERM and SIGHUP are requests to the attached RunControl: stop, then
/// abort; one more ends the process at once.
class InterruptScope {
 public:
  InterruptScope();
  ~InterruptScope();
  InterruptScope(const InterruptScope&) = delete;
  InterruptScope& operator=(const InterruptScope&) = delete;
};

}  // namespace vitreo
