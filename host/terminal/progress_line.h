// Progress line: how far a run is and how long it will take, on a terminal; plain lines elsewhere.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/progress_listener.h"
#include "host/session/remaining_time.h"

#include <iosfwd>
#include <mutex>
#include <optional>
#include <string>

namespace vitreo {

/// Thread-safe: a script goes on while the watchdog's alarm comes in.
class ProgressLine : public ProgressListener {
 public:
  /// `animate`: redraw one line in place (a terminal); else a line at each tenth of the way.
  ProgressLine(std::ostream& out, bool animate);
  ~ProgressLine() override;
  void progress(double fraction, const std::string& label) override;
  void message(const std::string& line) override;
  void question(const Question& asked) override;
  std::optional<std::string> typed() override;  // from the standard input, where that is a terminal
  void clear();                                 // takes the line away

 private:
  std::string text(double fraction, const std::string& label, std::optional<double> left) const;
  void wipe();
  std::mutex mutex_;  // of all below
  std::ostream& out_;
  bool animate_;
  RemainingTime remaining_;
  double shown_at_ = -1;  // s, wall clock
  int shown_tenth_ = -1;
  std::size_t width_ = 0;  // of the line on the screen, columns
};

}  // namespace vitreo
