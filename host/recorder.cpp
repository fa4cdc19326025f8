// SPDX-License-Identifier: Apache-2.0
#include "host/recorder.h"

#include "host/plot_layout.h"
#include "host/record_file.h"
#include "host/report.h"
#include "host/run_folder.h"

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <optional>
#include <stdexcept>

namespace vitreo {
namespace {

std::string folded(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

/// SQLite's names do not know case, and its sample tables have two columns of their own.
void check_channels(const StreamInfo& info) {
  std::vector<std::string> taken = {"seq", "t_ns"};
  if (info.channels.empty()) throw std::invalid_argument("stream \"" + info.name + "\" has no channels");
  for (const Channel& channel : info.channels) {
    quoted_identifier(channel.name);
    const std::string name = folded(channel.name);
    if (std::find(taken.begin(), taken.end(), name) != taken.end()) {
      throw std::invalid_argument("stream \"" + info.name + "\": channel \"" + channel.name + "\" is there twice");
    }
    taken.push_back(name);
  }
}

/// The scripts as they were, beside the data.
void keep_scripts(const std::filesystem::path& folder, const RunStart& start) {
  const auto keep = [&](const std::string& file, const std::string& text, const std::string& fallback) {
    if (text.empty()) return;
    std::filesystem::create_directory(folder / "script");
    const std::string stem = slug(std::filesystem::path(file).stem().string(), fallback);
    const bool taken = std::filesystem::exists(folder / "script" / (stem + ".lua"));
    write_file(folder / "script" / ((taken ? fallback + "_" + stem : stem) + ".lua"), text);
  };
  keep(start.protocol_file, start.protocol_text, "protocol");
  if (start.rig.is_object() && start.rig.contains("text") && start.rig["text"].is_string()) {
    keep(start.rig.value("file", ""), start.rig["text"].get<std::string>(), "rig");
  }
}

std::vector<unsigned char> png_of(const std::string& name, const cv::Mat& image) {
  const bool depth_fits = image.depth() == CV_8U || image.depth() == CV_16U;
  const int channels = image.channels();
  if (image.empty() || image.dims != 2 || !depth_fits || (channels != 1 && channels != 3 && channels != 4)) {
    throw std::invalid_argument("picture \"" + name + "\" must be grey or colour, 8 or 16 bit, and not empty");
  }
  std::vector<unsigned char> png;
  if (!cv::imencode(".png", image, png)) throw std::runtime_error("picture \"" + name + "\" cannot be made a PNG");
  return png;
}

std::string_view as_text(const std::vector<unsigned char>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

const char* to_string(Outcome outcome) {
  constexpr const char* kNames[] = {"completed", "failed", "stopped", "aborted"};
  return kNames[static_cast<std::size_t>(outcome)];
}

struct Recorder::State {
  State(std::filesystem::path where, const RunStart& what)
      : folder(std::move(where)), start(what), file(folder / "run.sqlite", what) {
    keep_scripts(folder, start);
  }

  void must_be_open() const {
    if (end) throw std::logic_error("the run has ended: its record is closed");
  }
  void write_outputs();
  template <class Action>
  void try_to(const char* what, Action action);

  std::filesystem::path folder;
  RunStart start;
  RecordFile file;
  std::vector<Stream> streams;
  std::vector<Figure> figures;
  std::vector<Plot> plots;
  std::vector<SvgDrawing> drawings;
  std::vector<Table> tables;
  std::vector<Picture> pictures;
  std::vector<Event> events;
  std::optional<RunEnd> end;
};

Recorder::Recorder(const std::filesystem::path& parent, const RunStart& start) {
  const std::filesystem::path stem = std::filesystem::path(start.protocol_file).stem();
  const std::filesystem::path folder = make_run_folder(parent, stem.string());
  try {
    state_ = std::make_unique<State>(folder, start);
  } catch (...) {  // a folder without a start record is nobody's; it was made a moment ago by this very call
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
    throw;
  }
}

Recorder::~Recorder() {
  try {
    finish({Outcome::failed, "never finished", 0, 0});
  } catch (const std::exception&) {  // nobody is left to be told
  }
}

const std::filesystem::path& Recorder::folder() const { return state_->folder; }
const RunStart& Recorder::start() const { return state_->start; }
const std::vector<Stream>& Recorder::streams() const { return state_->streams; }
const std::vector<Figure>& Recorder::figures() const { return state_->figures; }
const std::vector<Plot>& Recorder::plots() const { return state_->plots; }
const std::vector<SvgDrawing>& Recorder::drawings() const { return state_->drawings; }
const std::vector<Table>& Recorder::tables() const { return state_->tables; }
const std::vector<Picture>& Recorder::pictures() const { return state_->pictures; }
const std::vector<Event>& Recorder::events() const { return state_->events; }
const RunEnd* Recorder::end() const { return state_->end ? &*state_->end : nullptr; }

const Stream* Recorder::stream(const std::string& name) const {
  const auto& streams = state_->streams;
  const auto found =
      std::find_if(streams.begin(), streams.end(), [&](const auto& one) { return one.info.name == name; });
  return found == streams.end() ? nullptr : &*found;
}

int Recorder::add_stream(const StreamInfo& info) {
  state_->must_be_open();
  quoted_identifier(info.name);
  for (const Stream& one : state_->streams) {
    if (folded(one.info.name) == folded(info.name)) {
      throw std::invalid_argument("stream \"" + info.name + "\" is there already");
    }
  }
  check_channels(info);
  state_->file.add_stream(info);
  state_->streams.push_back({info, {}, {}});
  return static_cast<int>(state_->streams.size()) - 1;
}

void Recorder::sample(int stream, Time time, std::span<const double> values) {
  state_->must_be_open();
  if (stream < 0 || static_cast<std::size_t>(stream) >= state_->streams.size()) {
    throw std::invalid_argument(fmt::format("stream {} is not known", stream));
  }
  const auto index = static_cast<std::size_t>(stream);
  Stream& target = state_->streams[index];
  if (values.size() != target.info.channels.size()) {
    throw std::invalid_argument(fmt::format("stream \"{}\" has {} channels, not {}", target.info.name,
                                            target.info.channels.size(), values.size()));
  }
  target.times.push_back(time);
  target.values.insert(target.values.end(), values.begin(), values.end());
  state_->file.sample(index, target.times.size() - 1, time, values);
}

void Recorder::event(Time time, const std::string& kind, const std::string& text) {
  state_->must_be_open();
  state_->events.push_back({time, kind, text});
  state_->file.event(state_->events.back());
}

void Recorder::figure(const Figure& figure) {
  state_->must_be_open();
  auto& figures = state_->figures;
  const auto found =
      std::find_if(figures.begin(), figures.end(), [&](const auto& one) { return one.name == figure.name; });
  if (found == figures.end()) {
    figures.push_back(figure);
  } else {
    *found = figure;
  }
  state_->file.figure(figure);
}

void Recorder::plot(const Plot& plot) {
  state_->must_be_open();
  lay_out_plot(plot, 640, 360);  // throws here, where the script's line is known, and not in the report
  state_->plots.push_back(plot);
}

void Recorder::drawing(const std::string& title, const std::string& svg) {
  state_->must_be_open();
  if (!svg.starts_with("<svg xmlns=") || svg.find("</svg>") == std::string::npos)
    throw std::invalid_argument("svg: wants a whole SVG document, from <svg xmlns= to </svg>");
  state_->drawings.push_back({title, svg});
}

void Recorder::table(const Table& table) {
  state_->must_be_open();
  state_->tables.push_back(table);
  state_->file.table(table);
}

void Recorder::picture(const std::string& name, const std::string& caption, const cv::Mat& image) {
  state_->must_be_open();
  Picture picture{name, caption, png_of(name, image)};
  std::filesystem::create_directory(state_->folder / "frames");
  const std::string file = fmt::format("frames/{:03}_{}.png", state_->pictures.size() + 1, slug(name, "picture"));
  write_file(state_->folder / file, as_text(picture.png));
  state_->file.picture(picture, file);
  state_->pictures.push_back(std::move(picture));
}

/// A failed output is an event of the run; the others are still made.
template <class Action>
void Recorder::State::try_to(const char* what, Action action) {
  try {
    action();
  } catch (const std::exception& error) {
    events.push_back({streams.empty() || streams[0].times.empty() ? Time{} : streams[0].times.back(), "error",
                      std::string(what) + ": " + error.what()});
    try {
      file.event(events.back());
    } catch (const std::exception&) {  // the end record is on the disk already
    }
  }
}

/// Drawings come first, as in the report.
void Recorder::State::write_outputs() {
  std::size_t number = 0;
  const auto write = [&](const std::string& title, const auto& svg) {
    try_to("plot", [&] {
      std::filesystem::create_directory(folder / "plots");
      const std::string name = fmt::format("{:02}_{}.svg", ++number, slug(title, "plot"));
      write_file(folder / "plots" / name, svg());
    });
  };
  for (const SvgDrawing& one : drawings) write(one.title, [&] { return one.svg; });
  for (const Plot& one : plots) write(one.title, [&] { return to_svg(one); });
}

void Recorder::finish(const RunEnd& end) {
  if (state_->end) return;
  state_->end = end;
  std::exception_ptr trouble;
  const auto guarded = [&](auto action) {
    try {
      action();
    } catch (const std::exception&) {
      if (!trouble) trouble = std::current_exception();
    }
  };
  guarded([&] { state_->file.end(end, state_->streams); });
  state_->write_outputs();
  state_->try_to("report", [&] { write_file(folder() / "report.html", report_html(*this)); });
  state_->try_to("summary", [&] {
    write_file(folder() / "summary.json",
               summary(*this).dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  });
  guarded([&] { state_->file.close(); });
  if (trouble) std::rethrow_exception(trouble);
}

}  // namespace vitreo
