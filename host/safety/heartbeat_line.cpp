// SPDX-License-Identifier: Apache-2.0
#include "host/safety/heartbeat_line.h"

#include "devices/time/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

// Of the one-shot's pulse: its resistor, its capacitor and the chip's own constant make it shorter
// by up to a fifth. An edge that comes after that may be the first of a new pulse.
constexpr double kLeastPulse = 0.8;

// What the readings of two clocks may differ by without a sleep between them.
constexpr Time kSleepNoise = std::chrono::milliseconds(10);

Time time_of(clockid_t clock) {
  timespec now{};
  ::clock_gettime(clock, &now);
  return std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec);
}

/// For how long this computer has slept since its start. The best of some readings: each is too
/// small by what comes between its two.
Time slept() {
  Time most{};
  for (int i = 0; i < 3; ++i)
    most = std::max(most, time_of(CLOCK_BOOTTIME) - time_of(CLOCK_MONOTONIC));
  return most;
}

}  // namespace

void HeartbeatSettings::check() const {
  if (!(rate >= 10 && rate <= 100))
    throw std::invalid_argument("heartbeat must be in [10, 100] Hz");
  if (!(one_shot > 0 && one_shot <= 1)) throw std::invalid_argument("one_shot must be in (0, 1] s");
  if (!(pick_up >= 0 && pick_up <= 1)) throw std::invalid_argument("pick_up must be in [0, 1] s");
  if (!(answer_within > 0 && answer_within <= 5))
    throw std::invalid_argument("answer_within must be in (0, 5] s");
  // An edge may be one period late.
  if (kLeastPulse * one_shot < 2 / rate)
    throw std::invalid_argument(
        fmt::format("one_shot of {:.3g} ms is too short for a heartbeat of {:.3g} Hz: at least "
                    "{:.3g} ms are wanted",
                    one_shot * 1e3, rate, 2e3 / rate / kLeastPulse));
}

HeartbeatLine::HeartbeatLine(EnableLine& line, const HeartbeatSettings& settings, Clock& clock,
                             std::function<std::string()> why_not,
                             std::function<void(std::string)> failed)
    : line_(line),
      settings_(settings),
      clock_(clock),
      why_not_(std::move(why_not)),
      failed_(std::move(failed)) {
  settings_.check();
  task_ = clock_.spawn("heartbeat line", [this] { run(); });
}

// A current that flowed before the relay has closed would be a step when it does.
void HeartbeatLine::start() {
  if (beating_) return;
  beating_ = true;
  ++starts_;
  edge_ = clock_.now();
  clock_.notify(changed_);
  clock_.wait(
      changed_, [this] { return !beating_; }, later(clock_.now(), from_seconds(settings_.pick_up)));
}

void HeartbeatLine::stop() {
  beating_ = false;
  clock_.notify(changed_);
  line_.set(false);
}

bool HeartbeatLine::late() const { return beating_ && !lateness().empty(); }

/// Empty while the last edge's pulse is certainly there.
std::string HeartbeatLine::lateness() const {
  const double since = to_seconds(clock_.now() - edge_);
  if (since < kLeastPulse * settings_.one_shot) return "";
  return fmt::format("its last edge was {:.0f} ms ago, after which the amplifiers may be off",
                     since * 1e3);
}

void HeartbeatLine::run() {
  while (true) {
    clock_.wait(
        changed_, [this] { return beating_; }, kForever);
    try {
      beat();
    } catch (const DeviceError& error) {
      if (beating_) fail(error.what());
    }
  }
}

// High for half a period, low for the other: whichever edge the one-shot takes, one comes a period.
// Each turn is measured from the last, so that lost time is not caught up with in a burst.
void HeartbeatLine::beat() {
  const Time half = from_seconds(0.5 / settings_.rate);
  const int mine = starts_;
  const auto on = [this, mine] { return beating_ && starts_ == mine; };
  // The clock stands still while the computer sleeps; the pulse does not.
  const Time slept_before = slept();
  while (on()) {
    if (const std::string why = why_not_(); !why.empty()) return fail(why);
    // Before the edge: it must not switch amplifiers on again that have been off meanwhile.
    if (const std::string why = lateness(); !why.empty()) return fail(why);
    if (slept() - slept_before > kSleepNoise) return fail("the computer has slept");
    const Time now = clock_.now();
    line_.set(true);
    // Stopped while the edge was on its way: behind the low of stop().
    if (!on()) return line_.set(false);
    edge_ = now;
    clock_.wait(
        changed_, [&] { return !on(); }, later(now, half));
    if (!on()) return;
    line_.set(false);
    clock_.wait(
        changed_, [&] { return !on(); }, later(now, 2 * half));
  }
}

void HeartbeatLine::fail(const std::string& why) {
  beating_ = false;
  clock_.notify(changed_);
  failed_("the heartbeat line has stopped: " + why);
  try {
    line_.set(false);
  } catch (const DeviceError&) {
    // Its link may be what failed; without edges any level is off.
  }
}

}  // namespace vitreo
