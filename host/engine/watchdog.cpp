// SPDX-License-Identifier: Apache-2.0
#include "host/engine/watchdog.h"

#include "devices/time/quiet_thread.h"

namespace vitreo {
namespace {

constexpr std::chrono::milliseconds kLook{20};  // while something is being ended
constexpr std::chrono::milliseconds kIdle{50};  // else; a request wakes it

}  // namespace

Watchdog::Watchdog(RunControl& control, Clock& clock, const WatchdogLimits& limits,
                   WatchdogActions actions)
    : control_(control), clock_(clock), limits_(limits), actions_(std::move(actions)) {
  thread_ = quiet_thread([this] { watch(); });
}

Watchdog::~Watchdog() {
  done_ = true;
  control_.wake_watchdog();
  // Were it joined while it waits for its turn, it would wait for the baton that is held here.
  const StopShield shield(clock_);
  while (inside_) clock_.sleep_for(std::chrono::milliseconds(1));
  thread_.join();
}

void Watchdog::watch() {
  while (!done_) {
    control_.wait_for_request(control_.tier() == StopTier::none ? kIdle : kLook);
    if (done_) return;
    look_at_pace();
    look();
  }
}

/// The dead-man of the whole host: on the virtual clock time stands still while anything computes,
/// so only a run at the pace of the wall clock can be late.
void Watchdog::look_at_pace() {
  const Time stuck = clock_.stuck_for();
  if (stuck <= limits_.dead_man || !actions_.energized()) return;
  clock_.break_in(std::chrono::milliseconds(0));
  inside_ = true;
  try {
    actions_.trip(
        "dead-man: the host has not moved for " +
        std::to_string(std::chrono::duration_cast<std::chrono::milliseconds>(stuck).count()) +
        " ms");
  } catch (const std::exception&) {  // told by the interlock, which tries again
  }
  inside_ = false;
  clock_.leave();
}

void Watchdog::look() {
  const auto stopping = control_.since(StopTier::stop), aborting = control_.since(StopTier::abort);
  if (!stopping) return;
  tell();
  if (!aborting && *stopping > limits_.clean_up) {
    control_.request(StopTier::abort,
                     control_.reason() + "; its clean-up took too long after the stop");
    return;
  }
  if (!aborting) return;
  const auto patience =
      control_.tier() == StopTier::emergency ? std::chrono::milliseconds(0) : limits_.safe;
  if ((*aborting > patience && !control_.safe()) || *aborting > limits_.grace) take_over();
}

void Watchdog::tell() {
  const auto now = std::chrono::steady_clock::now();
  if (!actions_.tell || control_.since(StopTier::stop).value_or(limits_.told) <= limits_.told)
    return;
  if (now - told_at_ < limits_.told) return;
  const std::string text =
      to_string(control_.status()) + (control_.safe() ? "; the devices are safe" : "");
  if (text == told_) return;
  told_ = text;
  told_at_ = now;
  actions_.tell(text);
}

/// The script's thread has not come to make the devices safe. Whatever holds the baton loses it
/// until this is done.
void Watchdog::take_over() {
  clock_.break_in(std::chrono::milliseconds(5));
  inside_ = true;
  control_.make_safe();
  while (!done_) {
    if (control_.since(StopTier::abort).value_or(limits_.grace) >= limits_.grace) {
      control_.set_phase(RunPhase::not_responding);
      return actions_.give_up();
    }
    if (!clock_.displaced()) break;
    tell();
    std::this_thread::sleep_for(kLook);
    clock_.sleep_for(std::chrono::milliseconds(1));  // whoever comes back gets a turn
  }
  inside_ = false;
  clock_.leave();
}

}  // namespace vitreo
