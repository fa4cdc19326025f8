// Run data: what was asked of a run, what happened, what came out. Filled by the recorder while it
// goes on, by the reader afterwards.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/plot/plot.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

class PngImage;

/// What was asked.
struct RunStart {
  std::string protocol_file;
  std::string protocol_title;
  std::string protocol_text;
  nlohmann::json parameters;       // name: SI value
  nlohmann::json parameter_units;  // name: unit as the protocol declares it, "mm/s"; missing ones
                                   // are plain numbers
  nlohmann::json rig;              // as resolved, with "file" and "text"
  nlohmann::json versions;         // of the program, of its libraries
  std::uint64_t seed = 0;
  std::string operator_name;
  nlohmann::json devices;  // role: identity
  nlohmann::json files;    // file that the rig names (calibration, photograph): SHA-256
  /// UTC, ns since 1970, at which the run's clock was 0; nothing in records before version 5.
  std::optional<std::int64_t> t0_utc_ns{};
  std::string clock{};      // "real", "virtual" (host/record/meaning.h says what that means)
  nlohmann::json tags{};    // key: text
  nlohmann::json sample{};  // host/record/run_labels.h
};

/// lost: the program ended without an end record; only `vitreo recover` writes it.
enum class Outcome { completed, failed, stopped, aborted, lost };
const char* to_string(Outcome outcome);
std::optional<Outcome> outcome_named(const std::string& name);

/// high: act at once; medium: promptly; low: to be looked at.
enum class AlarmPriority { low, medium, high };
const char* to_string(AlarmPriority priority);
std::optional<AlarmPriority> alarm_priority_named(const std::string& name);
/// "high: interlock: coil 3: 14 A is beyond the limit of 12 A".
std::string alarm_text(AlarmPriority priority, const std::string& name, const std::string& text);

/// Who or what ended a run, for the end record: the words are those of stop.ended_by in
/// host/record/record_schema.cpp.
struct EndCause {
  std::string by{};      // "protocol", "person", "scheduler", "signal", ...; empty: not known
  std::string name{};    // of the person, the device, the scheduler or the sender
  std::string face{};    // "the terminal", "the control socket", "the live view"
  std::string signal{};  // "SIGTERM"
};
/// "person Ann at the control socket", "scheduler slurm (SIGTERM)".
std::string cause_text(const EndCause& cause);

struct RunEnd {
  Outcome outcome = Outcome::completed;
  std::string reason;          // one line; empty when completed
  double experiment_time = 0;  // s
  double wall_time = 0;        // s
  std::string location{};      // "protocols/drift.lua:12" where the script was; empty: not known
  EndCause cause{};
};

/// "protocols/drift.lua:12" where a reason begins with a script's line, else "".
std::string script_line(const std::string& reason);

struct Channel {
  std::string name;
  /// SI, or "px"; "1" for plain numbers, for which "" may be given ("" in old records).
  std::string unit;
  std::string help{};  // what it is, for the record; empty: not said
  std::string axes{};  // of a position, direction or pixel: host/record/meaning.h
};

struct StreamInfo {
  std::string name;    // "servo", "truth"
  std::string source;  // "the simulator's truth, which the loop never sees", "top camera"
  std::vector<Channel> channels;
  std::string clock{};  // to which instant a row's time belongs: host/record/meaning.h
};

/// A number that the run states as its result.
struct StatedResult {
  std::string name;
  double value;  // SI
  /// SI: shown in the display unit of that size; or a unit such as "um" or "%": shown in just that
  /// one. What programs read has its SI unit (si_unit()).
  std::string unit;
};

struct Picture {
  std::string name;
  std::string caption;
  std::string file;               // below the run's folder
  std::shared_ptr<PngImage> png;  // never null
};

struct Table {
  std::string title;
  std::vector<std::string> header;             // with units
  std::vector<std::vector<std::string>> rows;  // as shown
};

/// A drawing that is no plot, such as a layout of lenses.
struct SvgDrawing {
  std::string title;
  std::string svg;
};

struct Event {
  Time time{};
  std::string kind;
  std::string text;
};

/// A stream as it stands in memory: row-major samples.
struct Stream {
  StreamInfo info;
  std::vector<Time> times;
  std::vector<double> values;  // times.size() * channels
  double at(std::size_t row, std::size_t channel) const {
    return values[row * info.channels.size() + channel];
  }
};

/// A Lua file that the run's scripts required.
struct Module {
  std::string name;
  std::string file;
  std::string text;
};

/// One recorded frame, and where its pixels are.
struct FrameRow {
  std::string camera;        // role: "top_camera"
  std::uint64_t number = 0;  // the camera's own count
  Time exposed{};            // the host's clock at the middle of the exposure
  Time received{};           // the host's clock
  /// The instrument's own clock at the middle of the exposure, where it has one.
  std::optional<Time> device;
  std::string file;          // below the run's folder
  std::uint64_t offset = 0;  // of the pixels, row by row, uncompressed
  std::uint64_t bytes = 0;   // of the pixels
  int width_px = 0;
  int height_px = 0;
  int pixel_type = 0;       // as NDTiff has it: 0: 8 bit, 1: 16 bit, 2: 8-bit color
  std::uint32_t crc32 = 0;  // of the image as the camera gave it
  /// Frames lost to a full queue since the last recorded one of this camera.
  std::uint64_t dropped_before = 0;
  /// Exposures that never came to the recorder since then: lost by camera or link, or not taken in
  /// time.
  std::uint64_t lost_before = 0;
};

/// Frames that are missing before one that is recorded: counted apart, for the one is the disk's
/// fault and the other the camera's.
struct MissingFrames {
  std::uint64_t dropped = 0;  // FrameRow::dropped_before
  std::uint64_t lost = 0;     // FrameRow::lost_before
};

/// A camera whose frames are recorded, as stated when their recording began.
struct RecordedCameraInfo {
  std::string camera;  // role
  std::string identity;
  int every = 1;               // each n-th frame is recorded
  double frame_period = 0;     // s
  double effective_pixel = 0;  // m of the observed plane
  int bits = 8;                // that count of a pixel, the low ones
  int offset_x_px = 0;         // of the image's first pixel on the sensor
  int offset_y_px = 0;
};

/// What passed on an instrument's link (vitreo run --trace-links).
struct LinkRow {
  Time time{};
  std::string role;     // "stage"
  std::string address;  // "serial:/dev/ttyUSB0"; "channel 3, tcp:..." of a role with several links
  std::string event;    // "to" and "from" the instrument, "opened", "failed"
  std::vector<std::uint8_t> bytes;  // of "failed" the error's text
};

struct RunData {
  std::filesystem::path folder;
  int version = 0;  // of the record's schema
  RunStart start;
  std::optional<RunEnd> end;
  std::vector<Stream> streams;
  std::vector<StatedResult> results;
  std::vector<Plot> plots;
  std::vector<SvgDrawing> drawings;
  std::vector<Table> tables;
  std::vector<Picture> pictures;
  std::vector<Event> events;
  std::vector<Module> modules;
  std::vector<LinkRow> links;  // empty where the run was not asked for them
  std::vector<RecordedCameraInfo> cameras;
  std::vector<FrameRow> frames;  // the recorder leaves them to its writer: see Recorder::frames()
  std::vector<std::uint64_t> dropped;  // frames that were not recorded, one number a camera
  std::vector<std::uint64_t> lost;     // exposures that never came, one number a camera
  double held = 0;                     // s for which the recorder held up its callers
  const Stream* stream(const std::string& name) const;  // null where there is none
};

/// Kind of the events that say what is known of the coils after they were made safe, and the stream
/// of what was read back then, where something was.
inline constexpr const char* kCoilRest = "coils";
inline constexpr const char* kCoilReadBack = "coils_read_back";
/// "coils 0.00 A, read back at 12:03:11.250", the last of the run; empty where there is none.
std::string coil_rest_text(const RunData& data);

}  // namespace vitreo
