// CSV export: tables for spreadsheets, a file a stream.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/run_folder.h"
#include "host/record/parameter_text.h"
#include "host/record/record_json.h"
#include "host/runs/export.h"
#include "host/runs/run_clock.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

namespace vitreo {
namespace {

/// RFC 4180; and what a spreadsheet would take for a formula is made text.
/// A text of a script or a device that begins with '=' would be run by the spreadsheet in which the
/// export is opened.
std::string cell(const std::string& text) {
  const bool formula = !text.empty() && std::string("=+-@\t\r").find(text[0]) != std::string::npos;
  std::string quoted = "\"";
  if (formula) quoted += '\'';
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  quoted += '"';
  return formula || text.find_first_of(",\"\r\n") != std::string::npos ? quoted : text;
}

/// The shortest text that reads back as the same double; NaN is an empty cell.
std::string number(double value) { return std::isnan(value) ? "" : fmt::format("{}", value); }

/// Exact: nanoseconds have more digits than a double keeps after some days.
std::string seconds(Time time) {
  const std::int64_t ns = time.count();
  return fmt::format("{}{}.{:09}", ns < 0 ? "-" : "", std::abs(ns / 1000000000),
                     std::abs(ns % 1000000000));
}

std::string with_unit(const std::string& name, const std::string& unit) {
  return unit.empty() ? name : name + " (" + unit + ")";
}

// CRLF, as RFC 4180 has it.
std::string table_of(const Stream& stream) {
  std::string out = "t (s)";
  for (const Channel& channel : stream.info.channels)
    out += "," + cell(with_unit(channel.name, channel.unit));
  out += "\r\n";
  for (std::size_t row = 0; row < stream.times.size(); ++row) {
    out += seconds(stream.times[row]);
    for (std::size_t i = 0; i < stream.info.channels.size(); ++i)
      out += "," + number(stream.at(row, i));
    out += "\r\n";
  }
  return out;
}

std::string events_of(const RunData& data) {
  std::string out = "t (s),kind,text\r\n";
  for (const Event& event : data.events)
    out += seconds(event.time) + "," + cell(event.kind) + "," + cell(event.text) + "\r\n";
  return out;
}

std::string results_of(const RunData& data) {
  std::string out = "name,value,unit\r\n";
  for (const StatedResult& one : data.results)
    out += cell(one.name) + "," + number(one.value) + "," + cell(si_unit(one.unit)) + "\r\n";
  return out;
}

std::string frames_table(const RunData& data) {
  std::string out =
      "t (s),received (s),device (s),camera,number,file,offset,bytes,"
      "width_px,height_px,crc32,dropped_before\r\n";
  for (const FrameRow& row : data.frames)
    out += fmt::format("{},{},{},{},{},{},{},{},{},{},{:08x},{}\r\n", seconds(row.exposed),
                       seconds(row.received), row.device ? seconds(*row.device) : "",
                       cell(row.camera), row.number, cell(row.file), row.offset, row.bytes,
                       row.width_px, row.height_px, row.crc32, row.dropped_before);
  return out;
}

/// What the tables are of: a row a fact, so that a program reads it as a dictionary.
std::string run_table(const RunData& data) {
  std::string out = "key,value\r\n";
  const auto add = [&out](const std::string& key, const std::string& value) {
    out += cell(key) + "," + cell(value) + "\r\n";
  };
  add("run", data.folder.filename().string());
  add("title", data.start.protocol_title);
  add("operator", data.start.operator_name);
  add("seed", std::to_string(data.start.seed));
  add("outcome", data.end ? to_string(data.end->outcome) : "no end record");
  add("t0_utc", t0_utc_text(data));
  add("t0_utc_ns", std::to_string(t0_utc_ns(data)));
  add("clock", clock_text(data));
  for (const auto& [name, value] : data.start.parameters.items())
    add("parameter " + name, plain_parameter_text(data.start, name, value));
  for (const auto& [name, value] : data.start.tags.items())
    add("tag " + name, value.is_string() ? value.get<std::string>() : dumped(value));
  for (const auto& [name, value] : data.start.sample.items())
    add("sample " + name, value.is_string() ? value.get<std::string>() : dumped(value));
  return out;
}

/// The columns of the streams' tables, their units apart from their names.
std::string channels_table(const RunData& data) {
  std::string out = "stream,channel,unit,clock,axes,help,source\r\n";
  for (const Stream& stream : data.streams)
    for (const Channel& channel : stream.info.channels)
      out += cell(stream.info.name) + "," + cell(channel.name) + "," + cell(channel.unit) + "," +
             cell(stream.info.clock) + "," + cell(channel.axes) + "," + cell(channel.help) + "," +
             cell(stream.info.source) + "\r\n";
  return out;
}

}  // namespace

// Shared by all exports of images. Borrowed from `data`, which must outlive the result.
std::vector<const FrameRow*> frames_of(const RunData& data, const std::string& camera) {
  std::vector<const FrameRow*> rows;
  for (const FrameRow& row : data.frames) {
    if (row.camera != camera) continue;
    rows.push_back(&row);
    const FrameRow& first = *rows.front();
    if (row.width_px != first.width_px || row.height_px != first.height_px ||
        row.pixel_type != first.pixel_type)
      throw std::runtime_error(fmt::format(
          "{}: frame {} is of another size or kind than the first; no stack or film can "
          "hold both",
          camera, row.number));
  }
  return rows;
}

void export_csv(const RunData& data, ExportFolder& folder) {
  const auto add = [&](const std::string& name, const std::string& text) {
    write_file(folder.add(slug(name, "stream"), ".csv"), text);
  };
  // First, so that they have these names whatever a stream is called.
  add("run", run_table(data));
  add("channels", channels_table(data));
  add("events", events_of(data));
  add("results", results_of(data));
  if (!data.frames.empty()) add("frames", frames_table(data));
  for (const Stream& stream : data.streams) add(stream.info.name, table_of(stream));
}

}  // namespace vitreo
