// SPDX-License-Identifier: Apache-2.0
#include "host/interrupts.h"

#include <atomic>
#include <signal.h>
#include <unistd.h>

namespace vitreo {
namespace {

// A signal handler can reach nothing but what stands still: the one place of the program with such variables.
std::atomic<Clock*> the_clock{nullptr};
std::atomic<ScriptEngine*> the_engine{nullptr};
std::atomic<int> the_count{0};
constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP};

extern "C" void on_signal(int number) {
  if (++the_count >= 3) {
    signal(number, SIG_DFL);
    raise(number);
    return;
  }
  if (ScriptEngine* engine = the_engine) engine->interrupt();
  if (Clock* clock = the_clock) clock->interrupt();
}

}  // namespace

InterruptScope::InterruptScope(Clock& clock, ScriptEngine& engine) {
  the_count = 0;
  the_clock = &clock;
  the_engine = &engine;
  struct sigaction action = {};
  action.sa_handler = on_signal;
  for (const int number : kSignals) sigaction(number, &action, nullptr);
}

InterruptScope::~InterruptScope() {
  for (const int number : kSignals) signal(number, SIG_DFL);
  the_clock = nullptr;
  the_engine = nullptr;
}

}  // namespace vitreo
