// Record as text: the canonical export that two runs of one seed share, and the summary for
// programs.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/digest.h"
#include "host/files/png_image.h"
#include "host/record/disk_alarm.h"
#include "host/record/parameter_text.h"
#include "host/record/recorder.h"
#include "host/text/units.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

/// The shortest text that reads back as the same double (fmt's default).
std::string exact(double value) { return std::isnan(value) ? "nan" : fmt::format("{}", value); }

// JSON's own quoting in ASCII: a text with commas or line ends stays one field of one line.
std::string one_line(const std::string& text) {
  return nlohmann::json(text).dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

std::string export_stream(const Stream& stream) {
  std::string out =
      "stream " + one_line(stream.info.name) + " from " + one_line(stream.info.source) + "\nt_ns";
  for (const Channel& channel : stream.info.channels)
    out += "," + one_line(channel.name + " (" + channel.unit + ")");
  out += '\n';
  for (std::size_t row = 0; row < stream.times.size(); ++row) {
    out += fmt::format("{}", stream.times[row].count());
    for (std::size_t i = 0; i < stream.info.channels.size(); ++i)
      out += "," + exact(stream.at(row, i));
    out += '\n';
  }
  return out;
}

/// Of the parameters by name: SI units, and values as people read them.
struct ParameterUnits {
  nlohmann::json units = nlohmann::json::object();
  nlohmann::json texts = nlohmann::json::object();
};

ParameterUnits parameter_units(const RunStart& start) {
  ParameterUnits found;
  if (!start.parameters.is_object()) return found;
  for (const auto& [name, value] : start.parameters.items()) {
    const auto declared = find_unit(parameter_unit(start, name));
    if (value.is_number()) found.units[name] = declared ? declared->dimension : "";
    found.texts[name] = plain_parameter_text(start, name, value);
  }
  return found;
}

/// By camera: frames in the record, frames that the disk was too slow for, and exposures that never
/// came.
nlohmann::json frame_counts(const RunData& data) {
  nlohmann::json frames = nlohmann::json::object();
  for (std::size_t i = 0; i < data.cameras.size(); ++i) {
    const std::string& camera = data.cameras[i].camera;
    const auto recorded = std::count_if(data.frames.begin(), data.frames.end(),
                                        [&](const FrameRow& row) { return row.camera == camera; });
    frames[camera] = {{"recorded", recorded},
                      {"dropped", i < data.dropped.size() ? data.dropped[i] : 0},
                      {"lost", i < data.lost.size() ? data.lost[i] : 0}};
  }
  return frames;
}

}  // namespace

// A copy, since the rows of frames are the writer's until the run has ended.
std::string canonical_export(const Recorder& recorder) {
  RunData data = recorder.data();
  data.frames = recorder.frames();
  return canonical_export(data);
}

// Streams, frames, results, events, pictures, in the order of the record: a line each, so that a
// diff of two exports names what differs.
// Frames by the CRC-32 of their pixels and without file, offset or time of arrival: where they are
// stored is no part of what was seen.
std::string canonical_export(const RunData& data) {
  std::string out;
  for (const Stream& stream : data.streams) out += export_stream(stream);
  for (const FrameRow& row : data.frames)
    out += fmt::format("frame {} {} {} {} {:08x}\n", one_line(row.camera), row.number,
                       row.exposed.count(), row.received.count(), row.crc32);
  for (const StatedResult& one : data.results) {
    if (one.name.starts_with("wall_")) continue;  // of the wall clock: other in every run
    out +=
        "result " + one_line(one.name) + " " + exact(one.value) + " " + one_line(one.unit) + "\n";
  }
  for (const Event& event : data.events) {
    if (is_disk_alarm(event)) continue;
    out += fmt::format("event {} {} {}\n", event.time.count(), one_line(event.kind),
                       one_line(event.text));
  }
  for (const Picture& picture : data.pictures) {
    const std::vector<unsigned char>& png = picture.png->bytes();
    const std::string_view bytes(reinterpret_cast<const char*>(png.data()), png.size());
    out += "picture " + one_line(picture.name) + " " + sha256(bytes) + "\n";
  }
  for (const LinkRow& row : data.links)
    out += fmt::format("link {} {} {} {} {:02x}\n", row.time.count(), one_line(row.role),
                       one_line(row.address), row.event, fmt::join(row.bytes, ""));
  return out;
}

// JSON has no NaN and no infinity: such a result is null. A parameter's value is SI whatever unit
// was declared, and so the unit beside it is that of its dimension; its text has the declared one.
nlohmann::json summary(const RunData& data) {
  nlohmann::json results = nlohmann::json::object();
  nlohmann::json units = nlohmann::json::object();
  for (const StatedResult& one : data.results) {
    results[one.name] = std::isfinite(one.value) ? nlohmann::json(one.value) : nlohmann::json();
    units[one.name] = si_unit(one.unit);  // the value is SI, in whatever it is shown
  }
  nlohmann::json samples = nlohmann::json::object();
  for (const Stream& stream : data.streams) samples[stream.info.name] = stream.times.size();
  const ParameterUnits parameters = parameter_units(data.start);
  const auto& end = data.end;
  return {{"outcome", end ? to_string(end->outcome) : "running"},
          {"reason", end ? end->reason : ""},
          {"script_line",
           end ? (end->location.empty() ? script_line(end->reason) : end->location) : ""},
          {"coils_at_end", coil_rest_text(data)},
          {"run", data.folder.filename().string()},
          {"protocol", data.start.protocol_file},
          {"title", data.start.protocol_title},
          {"operator", data.start.operator_name},
          {"tags", data.start.tags.is_object() ? data.start.tags : nlohmann::json::object()},
          {"sample", data.start.sample.is_object() ? data.start.sample : nlohmann::json::object()},
          {"t0_utc_ns", data.start.t0_utc_ns ? nlohmann::json(*data.start.t0_utc_ns) : nullptr},
          {"clock", data.start.clock},
          {"ended_by", end ? end->cause.by : ""},
          {"ended_name", end ? end->cause.name : ""},
          {"ended_face", end ? end->cause.face : ""},
          {"ended_signal", end ? end->cause.signal : ""},
          {"seed", data.start.seed},
          {"parameters", data.start.parameters},
          {"parameter_units", parameters.units},
          {"parameters_text", parameters.texts},
          {"experiment_time", end ? end->experiment_time : 0},
          {"wall_time", end ? end->wall_time : 0},
          {"samples", samples},
          {"frames", frame_counts(data)},
          {"held", data.held},
          {"results", results},
          {"result_units", units}};
}

}  // namespace vitreo
