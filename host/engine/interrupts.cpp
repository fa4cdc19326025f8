// SPDX-License-Identifier: Apache-2.0
#include "host/engine/interrupts.h"

#include "host/session/run_control.h"

#include <atomic>
#include <signal.h>

namespace vitreo {
namespace {

constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP, SIGQUIT};

enum class SignalPhase { waiting, running, closing };
std::atomic<SignalPhase> phase{SignalPhase::waiting};
/// Tier by tier what the signals asked for that came before there was a run.
std::atomic<StopTier> early{StopTier::none};
/// The first of them, and the process that sent it.
std::atomic<int> early_number{0}, early_sender{0};
static_assert(std::atomic<SignalPhase>::is_always_lock_free &&
              std::atomic<StopTier>::is_always_lock_free);

StopTier asked_by(int number, StopTier before) noexcept {
  return number == SIGQUIT ? StopTier::abort : RunControl::next(before);
}

/// The guardian and the instruments' own time-outs are what is left then.
void end_process(int number) noexcept {
  signal(number, SIG_DFL);
  // The default action ends the process, and its parent sees by which signal.
  raise(number);
}

// In a signal handler: RunControl::request_by_signal() is async-signal-safe.
extern "C" void on_signal(int number, siginfo_t* info, void*) {
  // The outputs are safe by then, and what is left to do is bounded.
  if (phase == SignalPhase::closing) return;
  RunControl* const control = attached_control();
  const bool running = phase == SignalPhase::running && control != nullptr;
  const StopTier before = running ? control->tier() : early.load();
  if (before >= StopTier::abort && number != SIGQUIT) return end_process(number);
  // Of the terminal's own the kernel is the sender.
  const bool sent = info != nullptr && (info->si_code == SI_USER || info->si_code == SI_QUEUE ||
                                        info->si_code == SI_TKILL);
  // Tier by tier, whichever of the signals it is.
  const StopTier asked = asked_by(number, before);
  if (running) return control->request_by_signal(number, sent ? info->si_pid : 0, asked);
  if (early == StopTier::none) early_number = number;
  if (early == StopTier::none) early_sender = sent ? info->si_pid : 0;
  early = asked;
}

}  // namespace

InterruptScope::InterruptScope() {
  phase = SignalPhase::waiting;
  early = StopTier::none;
  struct sigaction action = {};
  action.sa_sigaction = on_signal;
  action.sa_flags = SA_RESTART | SA_SIGINFO;  // reading a line at the prompt goes on
  for (const int number : kSignals) sigaction(number, &action, nullptr);
}

InterruptScope::~InterruptScope() {
  // The process that prints the report afterwards can be ended as any other.
  for (const int number : kSignals) signal(number, SIG_DFL);
}

void InterruptScope::begin(RunControl& control) {
  // In this order: a signal between the two lines goes to the control itself.
  phase = SignalPhase::running;
  if (const StopTier asked = early; asked != StopTier::none)
    control.request_by_signal(early_number, early_sender, asked);
}

void InterruptScope::end() noexcept { phase = SignalPhase::closing; }

}  // namespace vitreo
