// SPDX-License-Identifier: Apache-2.0
#include "host/servo/loop_report.h"

#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>

namespace vitreo {

void LoopReport::report(bool is, bool& was, const std::string& what) {
  if (is && !was) recorder_.event(clock_.now(), "degraded", what);
  was = is;
}

void LoopReport::limits(const ControlStep& step, double period,
                        const std::function<std::string()>& advice) {
  report(step.limited, was_limited_,
         "a current limit cuts field or lateral force; the vertical force comes first" +
             (step.limited && !was_limited_ ? advice() : ""));
  report(step.outside, was_outside_,
         "the robot is outside the region of the field's model: the field of the nearest place in "
         "it is used");
  // Touched now and then while the robot rests, when nothing shows the delay: that says nothing.
  constexpr double kBoundMemory = 2;  // s
  bounded_ += ((step.at_bound ? 1 : 0) - bounded_) * std::min(1.0, period / kBoundMemory);
  report(bounded_ > 0.5, was_at_bound_,
         "the robot's response or the loop's delay is farther from the model than the loop's "
         "filter can follow");
  report(step.inconsistent, was_inconsistent_,
         "the robot does not move as the loop's filter expects: its innovations are more than "
         "twice as large as it says");
  quality(step.quality);
  report(step.passed_over, was_passed_over_,
         "a measurement was passed over: not a number, out of order, or a leap");
}

void LoopReport::kept_out(bool is) {
  report(is, was_kept_out_,
         "the keep-out margin changes the command: the robot would come nearer to a wall");
}

void LoopReport::quality(const LoopQuality& now) {
  constexpr double kExchanged = 1.5;  // lack: of a coil that carries the opposite it is 2
  const auto report = [this](bool is, bool was, const char* name, const std::string& what) {
    if (!is || was) return;
    recorder_.event(clock_.now(), "control", std::string(name) + ": " + what);
    recorder_.alarm(clock_.now(), name, AlarmPriority::medium, what);
  };
  report(now.oscillating, quality_.oscillating, "oscillation",
         fmt::format("the robot goes to and fro about its target by {} in {}",
                     format_quantity(now.amplitude, "m"), format_quantity(now.period, "s")));
  report(now.standing, quality_.standing, "standstill",
         "the robot is told to move and stands: it is held, or at a wall");
  report(now.off_target, quality_.off_target, "off target",
         "for seconds the robot has been more than 2 mm from its target, and comes no nearer");
  report(now.capped, quality_.capped, "speed cap",
         "for seconds the robot has been farther away than the largest speed of the feedback "
         "makes good");
  report(now.clamped, quality_.clamped, "disturbance clamp",
         "what pushes the robot is more than a free robot shows: it is held fast, or the field "
         "is not as commanded");
  report(now.weak_coil != 0, quality_.weak_coil == now.weak_coil, "weak coil",
         now.lack > kExchanged
             ? fmt::format("the leads of coil {} seem to be exchanged", now.weak_coil)
             : fmt::format("coil {} seems to carry {:.0f} % of what it is given", now.weak_coil,
                           100 * std::max(0.0, 1 - now.lack)));
  // No alarm: the thesis' law leaves what the field lacks standing, and is not to cry for it.
  if (now.rests_off > 0 && quality_.rests_off == 0)
    recorder_.event(clock_.now(), "control",
                    "off at rest: the robot stays " + format_quantity(now.rests_off, "m") +
                        " from a target that rests");
  worst_.oscillating |= now.oscillating;
  worst_.standing |= now.standing;
  worst_.off_target |= now.off_target;
  worst_.rests_off = std::max(worst_.rests_off, now.rests_off);
  worst_.kept_out |= now.kept_out;
  worst_.capped |= now.capped;
  worst_.clamped |= now.clamped;
  if (now.weak_coil != 0) worst_.weak_coil = now.weak_coil;
  quality_ = now;
}

}  // namespace vitreo
