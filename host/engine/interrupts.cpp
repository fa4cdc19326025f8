// SPDX-License-Identifier: Apache-2.0
#include "host/engine/interrupts.h"

#include "host/session/run_control.h"

#include <signal.h>

namespace vitreo {
namespace {

constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};

// In a signal handler: RunControl::request_by_signal() is async-signal-safe.
// The third signal, or one without a run, falls back to the default action: the guardian and the
// instruments' own time-outs are what is left then.
extern "C" void on_signal(int number, siginfo_t* info, void*) {
  RunControl* const control = attached_control();
  if (control == nullptr || control->tier() >= StopTier::abort) {
    signal(number, SIG_DFL);
    // The default action ends the process, and its parent sees by which signal.
    raise(number);
    return;
  }
  // Of the terminal's own the kernel is the sender.
  const bool sent = info != nullptr && (info->si_code == SI_USER || info->si_code == SI_QUEUE ||
                                        info->si_code == SI_TKILL);
  control->request_by_signal(number, sent ? info->si_pid : 0);
}

}  // namespace

InterruptScope::InterruptScope() {
  struct sigaction action = {};
  action.sa_sigaction = on_signal;
  action.sa_flags = SA_RESTART | SA_SIGINFO;  // reading a line at the prompt goes on
  for (const int number : kSignals) sigaction(number, &action, nullptr);
}

InterruptScope::~InterruptScope() {
  for (const int number : kSignals) signal(number, SIG_DFL);
}

}  // namespace vitreo
