// SPDX-License-Identifier: Apache-2.0
#include "host/record/recorder.h"

#include "host/files/manifest.h"
#include "host/files/png_image.h"
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"
#include "host/plot/plot_layout.h"
#include "host/record/data_sheet.h"
#include "host/record/disk_alarm.h"
#include "host/record/figures.h"
#include "host/record/portable_paths.h"
#include "host/record/record_schema.h"
#include "host/record/run_labels.h"
#include "host/record/run_lock.h"

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cctype>
#include <optional>
#include <stdexcept>

namespace vitreo {
namespace {

/// ASCII letters in lower case, as SQLite compares names.
std::string folded(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

/// SQLite's names do not know case, and its sample tables have two columns of their own.
void check_channels(const StreamInfo& info) {
  std::vector<std::string> taken = {"seq", "t_ns"};
  if (info.channels.empty())
    throw std::invalid_argument("stream \"" + info.name + "\" has no channels");
  for (const Channel& channel : info.channels) {
    quoted_identifier(channel.name);
    const std::string name = folded(channel.name);
    if (std::find(taken.begin(), taken.end(), name) != taken.end()) {
      throw std::invalid_argument("stream \"" + info.name + "\": channel \"" + channel.name +
                                  "\" is there twice");
    }
    taken.push_back(name);
  }
}

/// As the record has it: no unit is empty.
StreamInfo with_units(StreamInfo info) {
  for (Channel& channel : info.channels)
    if (channel.unit.empty()) channel.unit = "1";
  return info;
}

/// The scripts as they were, beside the data.
void keep_scripts(const std::filesystem::path& folder, const RunStart& start) {
  const auto keep = [&](const std::string& file, const std::string& text,
                        const std::string& fallback) {
    if (text.empty()) return;
    std::filesystem::create_directory(folder / "script");
    const std::string stem = slug(std::filesystem::path(file).stem().string(), fallback);
    const bool taken = std::filesystem::exists(folder / "script" / (stem + ".lua"));
    write_file(folder / "script" / ((taken ? fallback + "_" + stem : stem) + ".lua"), text);
  };
  // The rig file and those it builds on as their texts were when the run began, not as the files
  // are now.
  keep(start.protocol_file, start.protocol_text, "protocol");
  if (start.rig.is_object() && start.rig.contains("text") && start.rig["text"].is_string()) {
    keep(start.rig.value("file", ""), start.rig["text"].get<std::string>(), "rig");
    for (const nlohmann::json& base : start.rig.value("bases", nlohmann::json::array()))
      if (base.is_object()) keep(base.value("file", ""), base.value("text", ""), "rig_base");
    for (const nlohmann::json& one : start.rig.value("instruments", nlohmann::json::array()))
      if (one.is_object()) keep(one.value("file", ""), one.value("text", ""), "instrument");
  }
}

std::string_view as_text(const std::vector<unsigned char>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

// Members in the order of their birth: the lock is taken before anything is written, and released
// last. `writer`'s jobs refer to `data.folder`, which does not change after construction; `data`
// itself is touched by the run's threads alone.
struct Recorder::State {
  State(const std::filesystem::path& folder, const RunStart& start, const RecordLimits& limits)
      : asked(start), lock(folder), portable(paths.start(start)), writer(folder, portable, limits) {
    data.folder = folder;
    data.version = kRecordVersion;
    data.start = portable;
    keep_scripts(folder, start);
  }

  // A programming error, not one of the disk: hence std::logic_error.
  void must_be_open() const {
    if (data.end) throw std::logic_error("the run has ended: its record is closed");
  }
  void write_outputs();
  void write_labels();
  void drain_alarms(Time time);
  void raise(Time time, const std::string& name, AlarmPriority priority, const std::string& text);
  void add_event(const Event& event);
  template <class Action>
  void try_to(const char* what, Action action);

  const RunStart asked;
  PortablePaths paths;
  RunLock lock;
  const RunStart portable;
  RecordWriter writer;
  RunData data;
  AlarmListener listener;
  std::function<std::string(const RunData&)> report;
  RecordListener* observer = nullptr;
};

Recorder::Recorder(const std::filesystem::path& parent, const RunStart& start,
                   const RecordLimits& limits) {
  const std::filesystem::path stem = std::filesystem::path(start.protocol_file).stem();
  const std::filesystem::path folder = make_run_folder(parent, stem.string());
  try {
    // After the folder is made: before, its parent may not exist, and the disk could not be asked.
    DiskWatch(folder, limits.disk).check_start();
    state_ = std::make_unique<State>(folder, start, limits);
  } catch (...) {
    // A folder without a start record is no run's; it was made a moment ago by this very call.
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
    throw;
  }
}

Recorder::~Recorder() {
  try {
    finish({Outcome::failed, "never finished", 0, 0});
  } catch (const std::exception&) {
    // A destructor has no caller that could be told.
  }
}

const std::filesystem::path& Recorder::folder() const { return state_->data.folder; }
const RunStart& Recorder::start() const { return state_->asked; }
void Recorder::watch(RecordListener* listener) { state_->observer = listener; }
RecordListener* Recorder::listener() const { return state_->observer; }
const std::vector<Stream>& Recorder::streams() const { return state_->data.streams; }
const std::vector<StatedResult>& Recorder::results() const { return state_->data.results; }
const std::vector<Plot>& Recorder::plots() const { return state_->data.plots; }
const std::vector<SvgDrawing>& Recorder::drawings() const { return state_->data.drawings; }
const std::vector<Table>& Recorder::tables() const { return state_->data.tables; }
const std::vector<Picture>& Recorder::pictures() const { return state_->data.pictures; }
const std::vector<Event>& Recorder::events() const { return state_->data.events; }
const std::vector<LinkRow>& Recorder::links() const { return state_->data.links; }
const RunEnd* Recorder::end() const { return state_->data.end ? &*state_->data.end : nullptr; }
const RunData& Recorder::data() const { return state_->data; }
const Stream* Recorder::stream(const std::string& name) const { return state_->data.stream(name); }
std::string Recorder::fault() const { return state_->writer.fault(); }
void Recorder::on_fault(std::function<void()> call) { state_->writer.on_fault(std::move(call)); }

// While the run goes on the rows are the writer's: it is asked, and waits until they are written.
std::vector<FrameRow> Recorder::frames() const {
  return state_->data.end ? state_->data.frames : state_->writer.frames();
}

// The record in memory is kept whole beside the file: reports, canonical export and a second
// writing after a failed disk need it.
int Recorder::add_stream(const StreamInfo& info) {
  state_->must_be_open();
  quoted_identifier(info.name);
  for (const Stream& one : state_->data.streams) {
    if (folded(one.info.name) == folded(info.name)) {
      throw std::invalid_argument("stream \"" + info.name + "\" is there already");
    }
  }
  check_channels(info);
  const StreamInfo kept = with_units(info);
  state_->data.streams.push_back({kept, {}, {}});
  state_->writer.post([kept](RecordFile& file) { file.add_stream(kept); }, true);
  return static_cast<int>(state_->data.streams.size()) - 1;
}

// Every check comes before the first change: what throws std::invalid_argument leaves no trace in
// the record.
void Recorder::sample(int stream, Time time, std::span<const double> values) {
  state_->must_be_open();
  if (stream < 0 || static_cast<std::size_t>(stream) >= state_->data.streams.size()) {
    throw std::invalid_argument(fmt::format("stream {} is not known", stream));
  }
  const auto index = static_cast<std::size_t>(stream);
  Stream& target = state_->data.streams[index];
  if (values.size() != target.info.channels.size()) {
    throw std::invalid_argument(fmt::format("stream \"{}\" has {} channels, not {}",
                                            target.info.name, target.info.channels.size(),
                                            values.size()));
  }
  target.times.push_back(time);
  target.values.insert(target.values.end(), values.begin(), values.end());
  // First in memory, then in the queue: what the writer refuses now is written again at the end.
  state_->writer.sample(index, target.times.size() - 1, time, values);
  // After the record: the live view shows nothing that the record does not have.
  if (state_->observer != nullptr) state_->observer->sample(target.info, time, values);
  state_->drain_alarms(time);
}

// The number in the file is the place in memory, by which a second writing knows the event again.
// Urgent, so that it wakes the writer.
void Recorder::State::add_event(const Event& given) {
  const Event event{given.time, given.kind, paths.text(given.text)};
  data.events.push_back(event);
  if (observer != nullptr) observer->event(event.time, event.kind, event.text);
  writer.post(
      [event, number = data.events.size() - 1](RecordFile& file) { file.event(number, event); },
      true);
}

/// What the writer has to say becomes part of the record.
void Recorder::State::drain_alarms(Time time) {
  for (const std::string& said : writer.drain_alarms()) {
    const DiskAlarm alarm(said);
    raise(time, alarm.name, alarm.priority, alarm.text);
  }
}

void Recorder::State::raise(Time time, const std::string& name, AlarmPriority priority,
                            const std::string& text) {
  // The session's listener latches it and records the event itself; without one, in tests and
  // tools, the event is all.
  if (listener) return listener(name, priority, text);
  add_event({time, "alarm", alarm_text(priority, name, text)});
}

void Recorder::alarm(Time time, const std::string& name, AlarmPriority priority,
                     const std::string& text) {
  state_->must_be_open();
  state_->raise(time, name, priority, text);
}

void Recorder::on_alarm(AlarmListener listener) { state_->listener = std::move(listener); }

void Recorder::event(Time time, const std::string& kind, const std::string& text) {
  state_->must_be_open();
  state_->add_event({time, kind, text});
  state_->drain_alarms(time);
}

// A script may state a better value later, such as a running mean: one row a name.
void Recorder::result(const StatedResult& result) {
  state_->must_be_open();
  auto& results = state_->data.results;
  const auto found = std::find_if(results.begin(), results.end(),
                                  [&](const auto& one) { return one.name == result.name; });
  if (found == results.end()) {
    results.push_back(result);
  } else {
    *found = result;
  }
  state_->writer.post([result](RecordFile& file) { file.result(result); }, false);
}

void Recorder::plot(const Plot& plot) {
  state_->must_be_open();
  // Throws here, where the script's line is known, and not in the report.
  // The size does not matter: what throws are lengths, numbers and units.
  lay_out_plot(plot, 640, 360);
  state_->data.plots.push_back(plot);
  state_->writer.post(
      [plot, number = state_->data.plots.size() - 1](RecordFile& file) { file.plot(number, plot); },
      false);
}

/// What in an SVG runs a program when the file is opened by itself in a browser; empty: nothing.
/// Coarse on purpose: text that only looks so is refused as well.
std::string program_in(const std::string& svg) {
  std::string lower;
  for (const char c : svg) lower += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const char* const word : {"<script", "<foreignobject", "<iframe", "javascript:", "<!entity",
                                 "<handler", "<embed", "<object", "data:text"})
    if (lower.find(word) != std::string::npos) return word;
  // An attribute of an event: a space or a quote, "on", letters, "=".
  for (std::size_t at = lower.find("on"); at != std::string::npos; at = lower.find("on", at + 1)) {
    const bool begins =
        at > 0 && std::string(" \t\n\r\f\v/\"'").find(lower[at - 1]) != std::string::npos;
    std::size_t end = at;
    while (end < lower.size() && std::isalpha(static_cast<unsigned char>(lower[end])) != 0) ++end;
    const std::string name = lower.substr(at, end - at);
    while (end < lower.size() && std::isspace(static_cast<unsigned char>(lower[end])) != 0) ++end;
    if (begins && name.size() > 2 && end < lower.size() && lower[end] == '=') return name + "=";
  }
  return {};
}

// The report shows it as an image, in which no script runs; the file in plots/ may be opened by
// itself.
void Recorder::drawing(const std::string& title, const std::string& svg) {
  state_->must_be_open();
  if (!svg.starts_with("<svg xmlns=") || svg.find("</svg>") == std::string::npos)
    throw std::invalid_argument("svg: wants a whole SVG document, from <svg xmlns= to </svg>");
  const std::string program = program_in(svg);
  if (!program.empty())
    throw std::invalid_argument("svg: wants a drawing without programs, and this one has \"" +
                                program + "\"");
  auto& drawings = state_->data.drawings;
  drawings.push_back({title, svg});
  state_->writer.post([one = drawings.back(), number = drawings.size() - 1](
                          RecordFile& file) { file.drawing(number, one); },
                      false);
}

void Recorder::table(const Table& table) {
  state_->must_be_open();
  auto& tables = state_->data.tables;
  tables.push_back(table);
  state_->writer.post(
      [table, number = tables.size() - 1](RecordFile& file) { file.table(number, table); }, false);
}

void Recorder::picture(const std::string& name, const std::string& caption, const cv::Mat& image) {
  state_->must_be_open();
  auto& pictures = state_->data.pictures;
  // An image that cannot be a PNG is the script's error, at its line; encoded it is by the writer's
  // thread, for that takes longer than a loop may stand still. The caller may use its buffer again.
  Picture picture{name, caption, "", std::make_shared<PngImage>(name, image.clone())};
  picture.file = fmt::format("pictures/{:03}_{}.png", pictures.size() + 1, slug(name, "picture"));
  pictures.push_back(picture);
  // The file before its row: a row never names a picture that is not there.
  const auto write = [picture, number = pictures.size() - 1,
                      &folder = state_->data.folder](RecordFile& file) {
    std::filesystem::create_directory(folder / "pictures");
    write_file(folder / picture.file, as_text(picture.png->bytes()));
    file.picture(number, picture);
  };
  state_->writer.post(write, false);
}

void Recorder::tag(const std::string& key, const std::string& value) {
  state_->must_be_open();
  set_tag(state_->data.start.tags, key, value);
  state_->write_labels();
}

void Recorder::describe_sample(const std::string& field, const std::string& value) {
  state_->must_be_open();
  set_sample_field(state_->data.start.sample, field, value);
  state_->write_labels();
}

void Recorder::State::write_labels() {
  writer.post([tags = data.start.tags,
               sample = data.start.sample](RecordFile& file) { file.labels(tags, sample); },
              false);
}

// Called in the middle of an exchange, with the coils' zeros among them: a slow disk must not hold
// it up.
void Recorder::link(const LinkRow& row) {
  state_->must_be_open();
  auto& links = state_->data.links;
  links.push_back(row);
  state_->writer.offer(
      [row, number = links.size() - 1](RecordFile& file) { file.link(number, row); });
}

// The text as it was when it was required: a file that is edited during the run is recorded as it
// ran.
void Recorder::module(const Module& given) {
  state_->must_be_open();
  const Module module{given.name, state_->paths.file(given.file), given.text};
  auto& modules = state_->data.modules;
  const auto same = [&](const Module& one) { return one.name == module.name; };
  if (std::any_of(modules.begin(), modules.end(), same)) return;
  modules.push_back(module);
  const auto keep = [module, &folder = state_->data.folder](RecordFile& file) {
    std::filesystem::create_directories(folder / "script" / "modules");
    write_file(folder / "script" / "modules" / (slug(module.name, "module") + ".lua"), module.text);
    file.module(module);
  };
  state_->writer.post(keep, false);
}

// A camera is recorded once: two rates of one camera would mix in one stack.
int Recorder::add_camera(const RecordedCameraInfo& info) {
  state_->must_be_open();
  auto& cameras = state_->data.cameras;
  const auto same = [&](const auto& one) { return one.camera == info.camera; };
  if (info.every < 1) throw std::invalid_argument("every must be 1 or more");
  if (std::any_of(cameras.begin(), cameras.end(), same))
    throw std::invalid_argument("the frames of " + info.camera + " are recorded already");
  cameras.push_back(info);
  state_->writer.add_camera(info);
  return static_cast<int>(cameras.size()) - 1;
}

void Recorder::frame(int camera, const Frame& frame, std::uint64_t lost_before) {
  state_->must_be_open();
  if (camera < 0 || static_cast<std::size_t>(camera) >= state_->data.cameras.size())
    throw std::invalid_argument(fmt::format("camera {} is not known", camera));
  state_->writer.frame(static_cast<std::size_t>(camera), frame, lost_before);
  state_->drain_alarms(frame.received);
}

void Recorder::set_report(std::function<std::string(const RunData&)> report) {
  state_->report = std::move(report);
}

/// A failed output is an event of the run; the others are still made.
template <class Action>
void Recorder::State::try_to(const char* what, Action action) {
  try {
    action();
  } catch (const std::exception& error) {
    // The run's clock is not known here: the last sample of the first stream is the nearest that
    // is.
    const Time time = data.streams.empty() || data.streams[0].times.empty()
                          ? Time{}
                          : data.streams[0].times.back();
    data.events.push_back({time, "error", paths.text(std::string(what) + ": " + error.what())});
    writer.late_event(data.events.size() - 1, data.events.back());
  }
}

void Recorder::State::write_outputs() {
  for (const Figure& one : figures_of(data))
    try_to("plot", [&] {
      std::filesystem::create_directory(data.folder / "plots");
      write_file(data.folder / "plots" / (one.name + ".svg"), one.svg());
    });
  for (const Picture& one : data.pictures) {
    // A picture that a full disk had no room for is written now.
    if (std::filesystem::exists(data.folder / one.file)) continue;
    try_to("picture", [&] {
      std::filesystem::create_directory(data.folder / "pictures");
      write_file(data.folder / one.file, as_text(one.png->bytes()));
    });
  }
  if (report) try_to("report", [&] { write_file(data.folder / "report.html", report(data)); });
  try_to("data sheet", [&] { write_file(data.folder / kDataSheet, data_sheet(data)); });
  try_to("summary", [&] {
    write_file(data.folder / "summary.json",
               summary(data).dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  });
}

/// Each step is tried whatever became of those before it, and the first error is thrown last. The
/// order: the writer's queues, the end record, the files made of it, one plain database, the hashes
/// of all files, the folder itself.
void Recorder::finish(const RunEnd& end) {
  RunData& data = state_->data;
  if (data.end) return;
  std::exception_ptr failure;
  const auto guarded = [&](auto action) {
    try {
      action();
    } catch (const std::exception&) {
      if (!failure) failure = std::current_exception();
    }
  };
  // The clock is not known here: what the writer still has to say gets the last event's time.
  const Time last = data.events.empty() ? Time{} : data.events.back().time;
  guarded([&] { state_->writer.stop(); });
  for (const std::string& said : state_->writer.drain_alarms()) {
    const DiskAlarm alarm(said);
    data.events.push_back({last, "alarm", alarm_text(alarm.priority, alarm.name, alarm.text)});
    state_->writer.late_event(data.events.size() - 1, data.events.back());
  }
  // From here on every call of the run throws; the rows of frames become the record's own.
  data.end = end;
  data.end->reason = state_->paths.text(end.reason);
  data.end->location = state_->paths.text(end.location);
  data.frames = state_->writer.frames();
  data.dropped = state_->writer.dropped();
  data.lost = state_->writer.lost();
  data.held = state_->writer.held();
  guarded([&] { state_->writer.finish(*data.end, data); });
  // After the end record: a report that fails, or is killed half-way, no longer makes the run a
  // lost one.
  state_->write_outputs();
  guarded([&] { state_->writer.close(); });
  // The lock is still held, and the reserve is gone: the manifest passes the lock file over, which
  // vanishes with release().
  guarded([&] { write_manifest(data.folder); });
  guarded([&] { sync_folder(data.folder); });
  state_->lock.release();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace vitreo
