// Progress listener: interface to what displays a run's progress, messages and questions.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/questions.h"

#include <optional>
#include <string>

namespace vitreo {

/// Called on the script's thread, and on others that report (an alarm, the live view): an
/// implementation that is used so locks.
class ProgressListener {
 public:
  virtual ~ProgressListener() = default;
  /// `fraction` of the whole in [0, 1]; `label` says what is being done.
  virtual void progress(double fraction, const std::string& label) = 0;
  virtual void message(const std::string& line) = 0;  // print() and run:note()
  /// Shows a question.
  virtual void question(const Question& asked) { message(shown(asked)); }
  /// Polled while a question is open: the line that the operator has typed meanwhile, at most one a
  /// call; nothing where there is none, or no terminal.
  virtual std::optional<std::string> typed() { return std::nullopt; }
};

}  // namespace vitreo
