// Board: the state of a run for the live view, written by the run's threads, which never wait for a
// viewer, and read by the server's thread.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "host/record/record_listener.h"
#include "host/session/progress_listener.h"

#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::view {

struct Sample {
  Time time{};
  std::vector<double> values;
};

/// What is known of the coils after they were made safe.
struct Rest {
  double time = 0;  // s of the experiment
  std::string text;
  std::optional<std::vector<double>> amperes;  // A, as read back
};

struct Line {
  std::uint64_t number = 0;
  double time = 0;  // s of the experiment
  std::string kind;
  std::string text;
};

/// Listens to the record and to the script's messages, and passes the latter on to the terminal.
class Board final : public RecordListener, public ProgressListener {
 public:
  explicit Board(ProgressListener& terminal) : terminal_(terminal) {}

  void seen(const std::string& camera, const Frame& frame) override;
  void sample(const StreamInfo& stream, Time time, std::span<const double> values) override;
  void event(Time time, const std::string& kind, const std::string& text) override;

  void progress(double fraction, const std::string& label) override {
    terminal_.progress(fraction, label);
  }
  void message(const std::string& line) override;
  void question(const Question& asked) override { terminal_.question(asked); }
  std::optional<std::string> typed() override { return terminal_.typed(); }

  /// The newest frame of a camera with a number above `after`; nothing where there is none.
  std::optional<Frame> frame(const std::string& camera, std::optional<std::uint64_t> after) const;
  std::vector<std::string> cameras() const;
  std::vector<StreamInfo> streams() const;
  /// The last samples of a stream, at most `count`, those after `after` only; in time's order.
  std::vector<Sample> samples(const std::string& stream, std::optional<Time> after,
                              std::size_t count) const;
  std::vector<Line> lines(std::uint64_t after) const;
  std::optional<Rest> rest() const;  // the last one; nothing before the first
  Time now() const;                  // of the newest frame, sample or event

 private:
  void add_line(double time, const std::string& kind, const std::string& text);

  ProgressListener& terminal_;
  mutable std::mutex mutex_;
  std::map<std::string, Frame> frames_;
  struct Held {
    StreamInfo info;
    std::deque<Sample> samples;
  };
  std::map<std::string, Held> streams_;
  std::optional<Rest> rest_;
  std::deque<Line> lines_;
  std::uint64_t line_count_ = 0;
  Time newest_{};
};

}  // namespace vitreo::view
