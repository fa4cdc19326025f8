// MCAP export: the topics of a run (host/channels), what it was asked, its results and its report.
// SPDX-License-Identifier: Apache-2.0
#include "host/channels/run_topics.h"
#include "host/files/mcap_file.h"
#include "host/files/posix_file.h"
#include "host/record/parameter_text.h"
#include "host/record/record_json.h"
#include "host/runs/ahead.h"
#include "host/runs/export.h"
#include "host/runs/report.h"
#include "host/runs/run_clock.h"
#include "host/runs/run_reader.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

using Words = std::map<std::string, std::string>;

/// One message to write. Only these are sorted: texts, and above all pictures, are made one by one
/// when they are written.
struct Item {
  Time time;
  std::uint16_t channel;
  std::size_t source;  // its number in RunFile::sources_
  std::size_t row;
};

/// The message of a row; nothing where the row says nothing about the topic.
using Source = std::function<std::optional<std::string>(std::size_t row)>;

/// A file with its channels by topic: several sources may feed one.
class RunFile {
 public:
  RunFile(const std::filesystem::path& path, const RunData& data)
      : file_(path), data_(data), topics_(data.start, t0_utc_ns(data)) {}
  void collect();
  void write();
  void describe();
  void finish() { file_.finish(); }

 private:
  std::uint16_t channel_of(const Topic& topic);
  void add(const Topic& topic, Source source, const std::vector<Time>& times);
  void add_stream(const Stream& stream);
  void add_events();
  void add_frames();

  // In place of a source's number: the item is the picture of a frame.
  static constexpr std::size_t kPictures = std::numeric_limits<std::size_t>::max();

  McapFile file_;
  // Borrowed: the sources refer to the record until write() has returned.
  const RunData& data_;
  const RunTopics topics_;
  std::map<std::string, std::uint16_t> channels_;
  std::vector<Source> sources_;
  std::vector<Item> items_;
};

std::uint16_t RunFile::channel_of(const Topic& topic) {
  const auto known = channels_.find(topic.name);
  if (known != channels_.end()) return known->second;
  return channels_[topic.name] =
             file_.add_channel(topic.name, topic.schema_name, json_text(topic.schema));
}

/// Rows from a source: row number i at the i-th of `times`.
void RunFile::add(const Topic& topic, Source source, const std::vector<Time>& times) {
  const std::uint16_t channel = channel_of(topic);
  for (std::size_t row = 0; row < times.size(); ++row)
    items_.push_back({times[row], channel, sources_.size(), row});
  sources_.push_back(std::move(source));
}

void RunFile::add_stream(const Stream& stream) {
  const std::size_t width = stream.info.channels.size();
  for (const RowTopic& one : topics_.of_stream(stream.info))
    add(
        one.topic,
        [message = one.message, &stream, width](std::size_t row) {
          return message(stream.times[row], {stream.values.data() + row * width, width});
        },
        stream.times);
}

void RunFile::add_events() {
  std::vector<Time> times;
  for (const Event& event : data_.events) times.push_back(event.time);
  add(
      RunTopics::log(),
      [this](std::size_t row) {
        const Event& event = data_.events[row];
        return topics_.log_message(event.time, event.kind, event.text);
      },
      times);
}

/// Pictures have no source: they are made ahead, in the order of their items.
void RunFile::add_frames() {
  for (std::size_t row = 0; row < data_.frames.size(); ++row) {
    const FrameRow& frame = data_.frames[row];
    // Pixel type 1 is 16 bits of gray, which of Foxglove's schemas RawImage alone holds.
    items_.push_back({frame.exposed,
                      channel_of(RunTopics::image(frame.camera, frame.pixel_type == 1)), kPictures,
                      row});
  }
}

// What stands still stands at the begin of all times, so that a player that begins anywhere has it.
void RunFile::collect() {
  for (const Stream& stream : data_.streams) add_stream(stream);
  add_events();
  add_frames();
  Time first{0};
  for (const Item& item : items_) first = std::min(first, item.time);
  add(RunTopics::transforms(),
      [this, first](std::size_t) { return topics_.transforms_message(first); }, {first});
  add(RunTopics::scene(), [this, first](std::size_t) { return topics_.scene_message(first); },
      {first});
  // MCAP asks for no order. A reader that goes by time has to hold fewer chunks at once where their
  // spans do not overlap.
  // Stable: of one moment streams come before events, events before frames.
  std::stable_sort(items_.begin(), items_.end(),
                   [](const Item& a, const Item& b) { return a.time < b.time; });
}

void RunFile::write() {
  std::vector<std::size_t> frames;
  for (const Item& item : items_)
    if (item.source == kPictures) frames.push_back(item.row);
  // Encoding takes most of the time: threads do it ahead, and take() gives the pictures in the
  // order of `frames`, which is that of the items.
  Ahead pictures(frames.size(), [this, &frames](std::size_t number) {
    const FrameRow& frame = data_.frames[frames[number]];
    return topics_.image_message(frame.camera, frame.exposed, read_frame(data_, frame),
                                 ImageCoding::lossless);
  });
  for (const Item& item : items_) {
    const std::optional<std::string> text =
        item.source == kPictures ? pictures.take() : sources_[item.source](item.row);
    if (text) file_.message(item.channel, topics_.clock().ns(item.time), *text);
  }
}

/// A JSON object's values as texts.
/// MCAP's metadata maps strings to strings: numbers and lists become JSON text.
Words words_of(const nlohmann::json& object) {
  Words words;
  if (!object.is_object()) return words;
  for (const auto& [key, value] : object.items())
    words[key] = value.is_string() ? value.get<std::string>() : json_text(value);
  return words;
}

Words run_words(const RunData& data) {
  const RunStart& start = data.start;
  Words words{{"run", data.folder.filename()},
              {"title", start.protocol_title},
              {"protocol", std::filesystem::path(start.protocol_file).filename()},
              {"operator", start.operator_name},
              {"seed", std::to_string(start.seed)},
              {"t0_utc", t0_utc_text(data)},
              {"t0_utc_ns", std::to_string(t0_utc_ns(data))},
              {"clock", clock_text(data)}};
  words["outcome"] = data.end ? to_string(data.end->outcome) : "no end record";
  if (data.end) words["reason"] = data.end->reason;
  return words;
}

/// Metadata and attachments: what a reader asks who has the file alone.
void RunFile::describe() {
  file_.metadata("run", run_words(data_));
  Words parameters;
  for (const auto& [name, value] : data_.start.parameters.items())
    parameters[name] = plain_parameter_text(data_.start, name, value);
  file_.metadata("parameters", parameters);
  file_.metadata("parameters_si", words_of(data_.start.parameters));
  file_.metadata("sample", words_of(data_.start.sample));
  file_.metadata("tags", words_of(data_.start.tags));
  file_.metadata("versions", words_of(data_.start.versions));
  file_.metadata("devices", words_of(data_.start.devices));
  Words results;
  for (const StatedResult& one : data_.results)
    results[one.name] = fmt::format("{} {}", one.value, si_unit(one.unit));
  file_.metadata("results", results);
  const std::uint64_t end =
      topics_.clock().ns(data_.end ? from_seconds(data_.end->experiment_time) : Time{0});
  // Log times of the attachments: of the report the end of the run, of the protocol its begin.
  const std::filesystem::path report = data_.folder / "report.html";
  std::error_code error;
  file_.attachment("report.html", "text/html", end,
                   std::filesystem::is_regular_file(report, error) ? read_whole_file(report)
                                                                   : report_html(data_));
  file_.attachment(std::filesystem::path(data_.start.protocol_file).filename().string(),
                   "text/x-lua", topics_.clock().ns(Time{0}), data_.start.protocol_text);
}

}  // namespace

void export_mcap(const RunData& data, ExportFolder& folder) {
  RunFile file(folder.add("run", ".mcap"), data);
  // First: metadata and attachments each end the chunk that is open.
  file.describe();
  file.collect();
  file.write();
  file.finish();
}

}  // namespace vitreo
