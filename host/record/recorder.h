// Recorder: the record of a run while it grows (what was asked, what happened, what came out), one
// folder a run.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"
#include "host/record/record_listener.h"
#include "host/record/record_writer.h"
#include "host/record/run_data.h"

#include <nlohmann/json.hpp>
#include <opencv2/core/mat.hpp>

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// Not thread-safe: under the virtual clock the baton guards it. A thread of its own writes
/// (host/record/record_writer.h), so an error of the disk is thrown, as std::runtime_error naming
/// the file, by the calls that follow it; what is recorded after finish() throws std::logic_error.
/// Samples are never dropped: when the disk is behind, sample() waits, and an event "alarm" says
/// for how long.
class Recorder {
 public:
  /// Makes the folder `parent/NAME`, new and unique, and writes run.sqlite with the start record.
  /// Throws std::runtime_error naming the folder, also where the disk is too full to begin.
  Recorder(const std::filesystem::path& parent, const RunStart& start,
           const RecordLimits& limits = {});
  /// Writes the end record "failed: never finished" when finish() was not called.
  ~Recorder();
  const std::filesystem::path& folder() const;
  /// As it was given; the record has it without the machine's folders
  /// (host/record/portable_paths.h).
  const RunStart& start() const;

  /// Names of streams and of a stream's channels are unique but for case, and not empty:
  /// std::invalid_argument.
  int add_stream(const StreamInfo& info);
  /// One value a channel, NaN where there is none; std::invalid_argument for another number or an
  /// unknown stream.
  void sample(int stream, Time time, std::span<const double> values);
  void event(Time time, const std::string& kind, const std::string& text);
  /// Something that needs attention: an event "alarm", or, where there is a listener, the
  /// listener's to latch and to record.
  void alarm(Time time, const std::string& name, AlarmPriority priority, const std::string& text);
  using AlarmListener =
      std::function<void(const std::string& name, AlarmPriority, const std::string& text)>;
  void on_alarm(AlarmListener listener);
  void result(const StatedResult& result);  // a name stated again replaces the first
  void plot(const Plot& plot);              // throws as to_svg() does
  /// A whole SVG document; std::invalid_argument for another text. The report shows it as an image:
  /// nothing in it runs.
  void drawing(const std::string& title, const std::string& svg);
  void table(const Table& table);
  /// Stored as PNG.
  void picture(const std::string& name, const std::string& caption, const cv::Mat& image);

  /// Labels the run; std::invalid_argument as host/record/run_labels.h says.
  void tag(const std::string& key, const std::string& value);
  void describe_sample(const std::string& field, const std::string& value);

  /// What passed on a link. It never waits for the disk: what the queue has no room for is written
  /// at the end.
  void link(const LinkRow& row);
  /// A Lua file that the scripts required; once a name.
  void module(const Module& module);
  /// States a camera whose frames follow; returns its number. std::invalid_argument when it is
  /// there already.
  int add_camera(const RecordedCameraInfo& info);
  /// The pixels are shared, not copied. Where the disk is behind: waits, or
  /// (RecordLimits::drop_frames) drops, counts and raises an alarm; never silently. `lost_before`:
  /// exposures since the frame before that never came to the host, or were not taken in time.
  void frame(int camera, const Frame& frame, std::uint64_t lost_before = 0);

  const std::vector<Stream>& streams() const;
  const Stream* stream(const std::string& name) const;
  const std::vector<StatedResult>& results() const;
  const std::vector<Plot>& plots() const;
  const std::vector<SvgDrawing>& drawings() const;
  const std::vector<Table>& tables() const;
  const std::vector<Picture>& pictures() const;
  const std::vector<Event>& events() const;
  const std::vector<LinkRow>& links() const;
  std::vector<FrameRow> frames() const;  // waits until they are written
  /// All of it; frames and dropped only after finish().
  const RunData& data() const;

  /// Notified of samples and events from now on, and by the cameras' recording of frames; nullptr:
  /// none. Borrowed.
  void watch(RecordListener* listener);
  RecordListener* listener() const;

  /// Fault of the disk, "" while there is none. `call`: once, from another thread, when it begins.
  std::string fault() const;
  void on_fault(std::function<void()> call);

  /// Makes report.html of the record at finish(); without one there is no report.
  void set_report(std::function<std::string(const RunData&)> report);

  /// Writes the end record, then report.html, plots/*.svg and summary.json, and closes the file.
  /// Idempotent. An error of the report is recorded as an event, not thrown; one of run.sqlite is
  /// thrown when all else is done.
  void finish(const RunEnd& end);
  const RunEnd* end() const;  // null before finish

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// All streams, frames, results, events, pictures (hashed) and traced bytes as text: the bytes that
/// two runs of one seed must share. No run id, no wall-clock fields: results named wall_... are
/// left out, and alarms of the disk.
std::string canonical_export(const RunData& data);
std::string canonical_export(const Recorder& recorder);

/// What summary.json says: {"outcome", "reason", "run", "results": {name: SI}, ...}; the object
/// that `--json` ends with.
nlohmann::json summary(const RunData& data);

}  // namespace vitreo
