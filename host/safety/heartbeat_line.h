// Heartbeat line: toggles the line that enables the amplifiers for as long as the loops that must
// be alive are alive, so that hardware behind it switches them off when nothing here can any more.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/enable_line.h"
#include "devices/time/clock.h"

#include <functional>
#include <memory>
#include <string>

namespace vitreo {

struct HeartbeatSettings {
  double rate = 50;  // Hz: rising edges a second
  /// s: the pulse of the retriggerable one-shot behind the line, by its R and C. Without an edge
  /// for so long the amplifiers are off.
  double one_shot = 0.07;
  /// s, from the first edge until the relay has switched the amplifiers on.
  double pick_up = 0.05;
  /// s. An instrument behind the line that has owed an answer for longer gets no further edge.
  double answer_within = 0.15;
  void check() const;  // throws std::invalid_argument naming the setting
};

/// A task of the run's clock, under its baton: what holds the baton, or stops the process, stops
/// the beat. It rests, low, until start().
class HeartbeatLine {
 public:
  /// `why_not`, at each rising edge: why the amplifiers must be off, empty where they may be on.
  /// `failed`, once: the beat has stopped, for that reason, for the line's error, or because it
  /// came so late that the relay may have opened. Neither throws; line and clock outlive this.
  HeartbeatLine(EnableLine& line, const HeartbeatSettings& settings, Clock& clock,
                std::function<std::string()> why_not, std::function<void(std::string)> failed);

  /// Begins to beat, and returns when the relay has had its time, or the beat has stopped. Throws
  /// Stopped.
  void start();
  /// Low, and no beat until start(). Throws DeviceError: the line's.
  void stop();
  bool beating() const noexcept { return beating_; }
  /// Whether an edge is overdue: the task is held up in the line's own link.
  bool late() const;

 private:
  void run();
  void beat();
  void fail(const std::string& why);
  std::string lateness() const;

  EnableLine& line_;
  const HeartbeatSettings settings_;
  Clock& clock_;
  const std::function<std::string()> why_not_;
  const std::function<void(std::string)> failed_;
  bool beating_ = false;
  int starts_ = 0;  // a beat belongs to one of them
  Time edge_{};     // the last rising one, or start()
  Signal changed_;
  std::unique_ptr<Task> task_;  // last: it uses the others
};

}  // namespace vitreo
