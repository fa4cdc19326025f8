// SPDX-License-Identifier: Apache-2.0
#include "host/runs/report_files.h"

#include "host/files/child_process.h"
#include "host/files/run_folder.h"
#include "host/plot/plot_axes.h"
#include "host/record/figures.h"
#include "host/text/columns.h"
#include "host/text/markup.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <vector>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// Marked by a diamond in the timeline.
bool is_bad(const Event& event) {
  for (const char* kind : {"error", "alarm", "interlock", "unsafe"})
    if (event.kind == kind) return true;
  return false;
}

/// JSON without its quotes and braces.
/// Four digits for people: the record keeps them all.
std::string plain(const nlohmann::json& value) {
  if (value.is_number_float()) return format_number(value.get<double>(), 4);
  if (value.is_string()) return value.get<std::string>();
  if (!value.is_structured()) return value.dump();
  std::string out;
  for (const auto& [key, inner] : value.items())
    out += (out.empty() ? "" : ", ") + (value.is_object() ? key + " = " : "") + plain(inner);
  return value.is_array() ? "(" + out + ")" : out;
}

/// From 0 to the end by a step that clocks have, s; the end instead of what is too near to it.
/// Above a minute people read steps of clocks (15 s, 5 min, 6 h), which a decimal step would miss.
/// A mark too near to the end would overlap its label.
std::vector<double> round_times(double end) {
  constexpr double kMost = 6;     // steps
  constexpr double kNear = 0.11;  // of the whole
  double step = 0;
  for (const double clock :
       {15., 30., 60., 120., 300., 600., 900., 1800., 3600., 7200., 21600., 43200., 86400.})
    if (step == 0 && end > 60 && end / clock <= kMost) step = clock;
  if (step == 0) step = nice_step(end, kMost);
  std::vector<double> times;
  for (int i = 0; i * step < end * (1 - kNear); ++i) times.push_back(i * step);
  times.push_back(end);
  return times;
}

// Of the timeline, in CSS px, as the viewBox; the page scales the drawing to its width.
constexpr int kTimelineWidth = 960;
constexpr int kTimelineHeight = 44;
constexpr int kTimelineMargin = 12;
constexpr int kTimelineAxis = 16;        // y of the line of time
constexpr std::size_t kMostMarks = 500;  // more would be a black bar, and a slow page

/// x of a time on the timeline of a run that took `end` seconds.
double timeline_x(double seconds, double end) {
  return kTimelineMargin +
         (kTimelineWidth - 2 * kTimelineMargin) * std::clamp(seconds / end, 0.0, 1.0);
}

/// Round times below the axis, all in one unit.
std::string time_ticks(double end) {
  const std::vector<double> times = round_times(end);
  const Unit unit = *column_unit(times, "s");
  std::string out;
  for (const double time : times)
    out += fmt::format(
        "<line x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2}\" stroke=\"#999\"/><text "
        "x=\"{0:.1f}\" "
        "y=\"40\" text-anchor=\"{3}\">{4}</text>",
        timeline_x(time, end), kTimelineAxis, kTimelineAxis + 6,
        time == 0     ? "start"
        : time == end ? "end"
                      : "middle",
        format_number(unit.from_si(time)) + " " + std::string(unit.symbol));
  return out;
}

/// A dot, or a diamond for what went wrong: shape as well as color, for those who cannot tell the
/// colors apart. The event's words come up under the pointer.
std::string event_mark(const Event& event, double end) {
  const double x = timeline_x(to_seconds(event.time), end);
  const std::string title =
      "<title>" + escape_markup(event.kind + ": " + event_text(event.text)) + "</title>";
  if (is_bad(event))
    return fmt::format("<path d=\"M{0:.1f} 7l7 9l-7 9l-7 -9z\" fill=\"#d55e00\">{1}</path>", x,
                       title);
  return fmt::format(
      "<circle cx=\"{:.1f}\" cy=\"{}\" r=\"4.5\" fill=\"#0072b2\" "
      "fill-opacity=\"0.7\">{}</circle>",
      x, kTimelineAxis, title);
}

}  // namespace

// A text that only looks like JSON, "[stopped]", is shown as it is.
std::string event_text(const std::string& text) {
  if (!text.starts_with('{') && !text.starts_with('[')) return text;
  const auto value = nlohmann::json::parse(text, nullptr, false);
  return value.is_discarded() || value.empty() ? text : plain(value);
}

// The axis ends with the last event where that is later than the end record's time, as safe states
// and alarms after the end are. At most kMost marks: beyond that they hide each other, and the page
// grows without use. A mark's text is its <title>, the tooltip; the whole list stands below the
// strip.
std::string timeline_svg(const RunData& data) {
  double end = data.end ? data.end->experiment_time : 0;
  for (const Event& event : data.events) end = std::max(end, to_seconds(event.time));
  if (data.events.empty() || !(end > 0)) return "";
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" role=\"img\" "
      "font-family=\"sans-serif\" "
      "font-size=\"11\" fill=\"#555\"><line x1=\"{}\" x2=\"{}\" y1=\"{}\" y2=\"{}\" "
      "stroke=\"#999\"/>",
      kTimelineWidth, kTimelineHeight, kTimelineMargin, kTimelineWidth - kTimelineMargin,
      kTimelineAxis, kTimelineAxis);
  out += time_ticks(end);
  for (std::size_t i = 0; i < std::min(data.events.size(), kMostMarks); ++i)
    out += event_mark(data.events[i], end);
  return out + "</svg>";
}

// A program of its own and no library: librsvg would bring its whole stack into the host for a rare
// request. The document goes through the pipe, without a file in between.
void write_png_of_svg(const std::string& svg, const fs::path& file) {
  ChildProcess renderer(
      {"rsvg-convert", "--format", "png", "--zoom", "2", "--output", file.string()},
      ChildProcess::Pipe::to_input);
  const bool taken = renderer.write(svg);
  if (const int status = renderer.finish(); !taken || status != 0)
    throw std::runtime_error(fmt::format("{}: rsvg-convert ended with {}", file.string(), status));
}

std::vector<fs::path> write_plots(const RunData& data, const fs::path& folder, PlotFiles kind) {
  fs::create_directories(folder);
  std::vector<fs::path> files;
  for (const Figure& figure : figures_of(data)) {
    const bool png = kind == PlotFiles::png;
    files.push_back(folder / (figure.name + (png ? ".png" : ".svg")));
    if (png)
      write_png_of_svg(figure.svg(), files.back());
    else
      write_file(files.back(), figure.svg());
  }
  return files;
}

}  // namespace vitreo
