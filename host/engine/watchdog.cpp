// SPDX-License-Identifier: Apache-2.0
#include "host/engine/watchdog.h"

#include "devices/time/quiet_thread.h"
#include "devices/time/turn_sharing.h"

namespace vitreo {
namespace {

constexpr std::chrono::milliseconds kEndingPeriod{20};  // of the checks, while a run is being ended
constexpr std::chrono::milliseconds kIdlePeriod{50};    // else; a request wakes the thread at once
// Of the grace (60 s by default): so long a script may compute, while the loops go on beside it.
constexpr int kScriptGraces = 12;

}  // namespace

Watchdog::Watchdog(RunControl& control, Clock& clock, const WatchdogLimits& limits,
                   WatchdogActions actions)
    : control_(control), clock_(clock), limits_(limits), actions_(std::move(actions)) {
  thread_ = quiet_thread([this] { watch(); });
}

Watchdog::~Watchdog() {
  done_ = true;
  control_.wake_watchdog();
  // The baton is held here: the thread, joined while it waits for its turn, would wait for ever. So
  // it gets its turns until it is done, whatever stop is requested meanwhile.
  const StopShield shield(clock_);
  while (inside_) clock_.sleep_for(std::chrono::milliseconds(1));
  thread_.join();
}

// This thread holds no baton except between break_in() and leave(), so it runs while everything
// else is stuck; it reads atomics and the control only.
void Watchdog::watch() {
  while (!done_) {
    control_.wait_for_request(control_.tier() == StopTier::none ? kIdlePeriod : kEndingPeriod);
    if (done_) return;
    check_pace();
    check_ending();
    check_between();
  }
}

/// The dead-man of the whole host: on the virtual clock time stands still while anything computes,
/// so only a run at the pace of the wall clock can be late.
void Watchdog::check_pace() {
  const auto text = [](Time time) {
    return std::to_string(std::chrono::duration_cast<std::chrono::milliseconds>(time).count()) +
           " ms";
  };
  const TurnSharing* const sharing = turn_sharing(clock_);
  const Time stuck = clock_.stuck_for(), alone = sharing ? sharing->alone_for() : Time(0);
  const auto open = [this](Time patience, const std::string& why) {
    clock_.break_in(patience);
    inside_ = true;
    try {
      actions_.trip(why);
    } catch (const std::exception&) {
      // Reported by the interlock, which tries again.
    }
    inside_ = false;
    clock_.leave();
  };
  // At once: the thread that has the baton does not move.
  if (stuck > limits_.dead_man && actions_.energized())
    open(Time(0), "dead-man: the host has not moved for " + text(stuck));
  // A loop holds for as long as its script computes, but not for a script that never comes back.
  if (alone > kScriptGraces * limits_.grace && actions_.energized())
    open(limits_.safe,
         "dead-man: the script has computed for " + text(alone) + " without a call to the host");
}

/// The deadlines of an end: a clean-up that is too long becomes an abort; an abort that the
/// script's thread does not carry out in time is carried out here.
void Watchdog::check_ending() {
  const auto stopping = control_.since(StopTier::stop);
  const auto aborting = control_.since(StopTier::abort);
  if (!stopping) return;
  report();
  if (!aborting && *stopping > limits_.clean_up) {
    control_.request(StopTier::abort,
                     control_.reason() + "; its clean-up took too long after the stop",
                     {"watchdog"});
    return;
  }
  if (!aborting) return;
  const auto patience =
      control_.tier() == StopTier::emergency ? std::chrono::milliseconds(0) : limits_.safe;
  // Safe by force, or given up although safe: the script does not unwind.
  if ((*aborting > patience && !control_.safe()) || *aborting > limits_.grace) take_over();
}

/// What is asked between two statements of the prompt is answered there; here where it does not.
void Watchdog::check_between() {
  if (control_.between().since().value_or(Time(0)) <= limits_.safe) return;
  clock_.break_in(std::chrono::milliseconds(5));
  inside_ = true;
  control_.make_safe_between();
  inside_ = false;
  clock_.leave();
}

/// Reports a change of the state of a stop that takes its time, at most once an interval.
void Watchdog::report() {
  const auto now = std::chrono::steady_clock::now();
  if (!actions_.report ||
      control_.since(StopTier::stop).value_or(limits_.report_interval) <= limits_.report_interval)
    return;
  if (now - reported_at_ < limits_.report_interval) return;
  const std::string text =
      to_string(control_.status()) + (control_.safe() ? "; the devices are safe" : "");
  if (text == reported_) return;
  reported_ = text;
  reported_at_ = now;
  actions_.report(text);
}

/// The script's thread has not come to make the devices safe. Whatever holds the baton loses it
/// until this is done.
void Watchdog::take_over() {
  clock_.break_in(std::chrono::milliseconds(5));
  inside_ = true;
  control_.make_safe();
  while (!done_) {
    const auto aborting = control_.since(StopTier::abort);
    // At the prompt: the statement has come to its end.
    if (!aborting) break;
    if (*aborting >= limits_.grace) {
      control_.set_phase(RunPhase::not_responding);
      actions_.give_up();
      break;
    }
    // The thread that lost the baton has come back: it unwinds from here on.
    if (!clock_.displaced()) break;
    report();
    std::this_thread::sleep_for(kEndingPeriod);
    // A thread that has come back to life gets its turn here.
    clock_.sleep_for(std::chrono::milliseconds(1));
  }
  inside_ = false;
  clock_.leave();
}

}  // namespace vitreo
