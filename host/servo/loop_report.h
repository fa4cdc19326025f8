// Report of a servo loop's limitations and of the quality of its control: an event or alarm each
// time that one begins.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/servo/servo_controller.h"

#include <functional>
#include <string>

namespace vitreo {

class LoopReport {
 public:
  LoopReport(Clock& clock, Recorder& recorder) : clock_(clock), recorder_(recorder) {}
  /// One turn; `period`: s, between turns. `advice` is asked for what helps where a limit begins to
  /// cut.
  void limits(const ControlStep& step, double period, const std::function<std::string()>& advice);
  /// Whether the keep-out margin changed the command.
  void kept_out(bool is);
  /// What was wrong since forget_worst().
  const LoopQuality& worst() const { return worst_; }
  void forget_worst() { worst_ = {}; }

 private:
  void report(bool is, bool& was, const std::string& what);
  void quality(const LoopQuality& now);

  Clock& clock_;
  Recorder& recorder_;
  bool was_limited_ = false;
  bool was_outside_ = false;
  bool was_passed_over_ = false;
  bool was_at_bound_ = false;
  double bounded_ = 0;  // part of the last turns in which the filter met a bound
  bool was_inconsistent_ = false;
  bool was_kept_out_ = false;
  LoopQuality quality_;  // of the last turn
  LoopQuality worst_;
};

}  // namespace vitreo
