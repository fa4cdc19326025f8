// Operator's desk: the one dispatcher of commands to a running run, whether they come from the
// control socket, the page in the browser or the script.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/rights.h"
#include "host/session/alarms.h"
#include "host/session/hand_controls.h"
#include "host/session/operator_targets.h"
#include "host/session/questions.h"
#include "host/session/run_control.h"

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// One command. `word` is one of OperatorDesk::words(); each takes what of the rest it needs.
struct OperatorCommand {
  std::string word{};
  std::string by{};      // a person's name; empty: not said
  std::string source{};  // "the control socket", "the live view", "the script"
  /// Checkpoint of a pause, answer's text, alarm's name, reason of an end, quantity to adjust.
  std::string text{};
  std::optional<double> to{};              // of "adjust", SI; without it the instruments are read
  bool override_condition = false;         // resume although the condition for it does not hold
  std::vector<Eigen::Vector3d> targets{};  // m, world: positions to be passed one after the other
};

/// Any thread. Borrows all that it commands.
class OperatorDesk {
 public:
  OperatorDesk(RunControl& control, Questions& questions, Alarms& alarms, OperatorTargets& targets)
      : control_(control), questions_(questions), alarms_(alarms), targets_(targets) {}

  /// Of the rig: who may override. Before the run's faces begin.
  void set_rights(Rights rights) { rights_ = std::move(rights); }
  /// What "adjust" speaks to, until it is taken away (null).
  void offer(HandControls* controls);

  /// "stop", "abort", "emergency", "pause", "resume", "answer", "ack", "target", "adjust".
  static const std::vector<std::string>& words();
  /// Whether the word ends the run: open to everyone, wherever it is asked.
  static bool ends_run(const std::string& word);
  /// Throws std::invalid_argument for an unknown word, an answer that does not fit, no such alarm,
  /// targets that are not taken, nothing to adjust; RightError for an override that is not this
  /// person's.
  void perform(const OperatorCommand& command);

  /// {"phase", "tier", "waiting_for", "note", "text", "progress", "doing", "alarms"; "remaining",
  /// "question" and "instruments" where there are such}: what every face shows of a run.
  nlohmann::json status() const;
  /// Changes each time that status() may.
  unsigned long changes() const noexcept;

 private:
  void end(StopTier tier, const OperatorCommand& command);
  void resume(const OperatorCommand& command);
  void acknowledge(const OperatorCommand& command);
  void adjust(const OperatorCommand& command);

  RunControl& control_;
  Questions& questions_;
  Alarms& alarms_;
  OperatorTargets& targets_;
  Rights rights_;
  mutable std::mutex mutex_;  // of what follows
  HandControls* controls_ = nullptr;
};

}  // namespace vitreo
