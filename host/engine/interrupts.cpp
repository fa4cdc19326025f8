// SPDX-License-Identifier: Apache-2.0
#include "host/engine/interrupts.h"

#include "host/session/run_control.h"

#include <signal.h>

namespace vitreo {
namespace {

constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};

// In a signal handler: RunControl::request(tier) is async-signal-safe.
// The third signal, or one without a run, falls back to the default action: the guardian and the
// instruments' own time-outs are what is left then.
extern "C" void on_signal(int number) {
  RunControl* const control = attached_control();
  if (control == nullptr || control->tier() >= StopTier::abort) {
    signal(number, SIG_DFL);
    // The default action ends the process, and its parent sees by which signal.
    raise(number);
    return;
  }
  control->request(RunControl::next(control->tier()));
}

}  // namespace

InterruptScope::InterruptScope() {
  struct sigaction action = {};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESTART;  // reading a line at the prompt goes on
  for (const int number : kSignals) sigaction(number, &action, nullptr);
}

InterruptScope::~InterruptScope() {
  for (const int number : kSignals) signal(number, SIG_DFL);
}

}  // namespace vitreo
