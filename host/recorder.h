// The record of a run: what was asked, what happened, what came out; one folder a run.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"
#include "host/plot.h"

#include <nlohmann/json.hpp>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// What was asked.
struct RunStart {
  std::string protocol_file, protocol_title, protocol_text;
  nlohmann::json parameters;       // name: SI value
  nlohmann::json parameter_units;  // name: unit as the protocol declares it, "mm/s"; missing ones are plain numbers
  nlohmann::json rig;              // as resolved, with "file" and "text"
  nlohmann::json versions;         // of the program, of its libraries
  std::uint64_t seed = 0;
  std::string operator_name;
};

enum class Outcome { completed, failed, stopped, aborted };
const char* to_string(Outcome outcome);

struct RunEnd {
  Outcome outcome = Outcome::completed;
  std::string reason;                         // one line; empty when completed
  double experiment_time = 0, wall_time = 0;  // s
};

struct Channel {
  std::string name, unit;  // unit: SI, "" for plain numbers
};

struct StreamInfo {
  std::string name;    // "servo", "truth"
  std::string source;  // "simulator truth (never seen by the loop)", "top camera"
  std::vector<Channel> channels;
};

struct Figure {
  std::string name;
  double value;      // SI
  std::string unit;  // SI: shown in people's unit of that size; or a unit such as "um": shown in just that one
};

struct Picture {
  std::string name, caption;
  std::vector<unsigned char> png;
};

struct Table {
  std::string title;
  std::vector<std::string> header;             // with units
  std::vector<std::vector<std::string>> rows;  // as shown
};

/// A drawing that is no plot, such as a layout of lenses.
struct SvgDrawing {
  std::string title, svg;
};

struct Event {
  Time time{};
  std::string kind, text;
};

/// A stream as it stands in memory: row-major samples.
struct Stream {
  StreamInfo info;
  std::vector<Time> times;
  std::vector<double> values;  // times.size() * channels
  double at(std::size_t row, std::size_t channel) const { return values[row * info.channels.size() + channel]; }
};

/// Not thread-safe: under the virtual clock the baton guards it. Errors of the disk throw std::runtime_error naming the
/// file; what is recorded after finish() throws std::logic_error.
class Recorder {
 public:
  /// Makes the folder `parent/NAME`, new and unique, and writes run.sqlite with the start record. `name_time` is the
  /// wall clock as shown in the folder's name.
  Recorder(const std::filesystem::path& parent, const RunStart& start);
  /// Writes the end record "failed: never finished" when finish() was not called.
  ~Recorder();
  const std::filesystem::path& folder() const;
  const RunStart& start() const;

  /// Names of streams and of a stream's channels are unique but for case, and not empty: std::invalid_argument.
  int add_stream(const StreamInfo& info);
  /// One value a channel, NaN where there is none; std::invalid_argument for another number or an unknown stream.
  void sample(int stream, Time time, std::span<const double> values);
  void event(Time time, const std::string& kind, const std::string& text);
  void figure(const Figure& figure);  // a name stated again replaces the first
  void plot(const Plot& plot);        // throws as to_svg() does
  /// A whole SVG document; std::invalid_argument for another text. The report shows it as an image: nothing in it runs.
  void drawing(const std::string& title, const std::string& svg);
  void table(const Table& table);
  void picture(const std::string& name, const std::string& caption, const cv::Mat& image);  // stored as PNG

  const std::vector<Stream>& streams() const;
  const Stream* stream(const std::string& name) const;
  const std::vector<Figure>& figures() const;
  const std::vector<Plot>& plots() const;
  const std::vector<SvgDrawing>& drawings() const;
  const std::vector<Table>& tables() const;
  const std::vector<Picture>& pictures() const;
  const std::vector<Event>& events() const;

  /// Writes the end record, then report.html, plots/*.svg and summary.json, and closes the file. Idempotent. An error
  /// of the report is recorded as an event, not thrown; one of run.sqlite is thrown when all else is done.
  void finish(const RunEnd& end);
  const RunEnd* end() const;  // null before finish

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// All streams, figures, events and pictures (hashed) as text: the bytes that two runs of one seed must share. No run
/// id, no wall-clock fields: figures named wall_... are left out.
std::string canonical_export(const Recorder& recorder);

/// What summary.json says: {"outcome", "reason", "run", "figures": {name: SI}, ...}; the object that `--json` ends
/// with.
nlohmann::json summary(const Recorder& recorder);

}  // namespace vitreo
