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

// In a signal handler: RunControl::request(tier) is async-signal-safe.
extern "C" void on_signal(int number) {
  if (phase == SignalPhase::closing) return;
  RunControl* const control = attached_control();
  const bool running = phase == SignalPhase::running && control != nullptr;
  const StopTier before = running ? control->tier() : early.load();
  if (before >= StopTier::abort && number != SIGQUIT) return end_process(number);
  const StopTier asked = asked_by(number, before);
  if (running)
    control->request(asked);
  else
    early = asked;
}

}  // namespace

InterruptScope::InterruptScope() {
  phase = SignalPhase::waiting;
  early = StopTier::none;
  struct sigaction action = {};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESTART;  // reading a line at the prompt goes on
  for (const int number : kSignals) sigaction(number, &action, nullptr);
}

InterruptScope::~InterruptScope() {
  for (const int number : kSignals) signal(number, SIG_DFL);
}

void InterruptScope::begin(RunControl& control) {
  phase = SignalPhase::running;
  if (const StopTier asked = early; asked != StopTier::none) control.request(asked);
}

void InterruptScope::end() noexcept { phase = SignalPhase::closing; }

}  // namespace vitreo
