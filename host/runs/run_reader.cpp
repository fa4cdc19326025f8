// SPDX-License-Identifier: Apache-2.0
#include "host/runs/run_reader.h"

#include "host/files/ndtiff.h"
#include "host/files/png_image.h"
#include "host/files/posix_file.h"
#include "host/files/sqlite.h"
#include "host/record/record_json.h"
#include "host/runs/open_record.h"
#include "host/runs/run_outline.h"
#include "host/text/error_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <limits>
#include <string_view>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kShownCandidates = 5;

/// JSON from the record; discarded where it is none.
nlohmann::json parsed(const std::string& text) {
  return nlohmann::json::parse(text, nullptr, false);
}

// A broken text of the start record must not hide the samples: it reads as "nothing known".
nlohmann::json object_of(const std::string& text) {
  nlohmann::json json = parsed(text);
  return json.is_discarded() ? nlohmann::json::object() : json;
}

/// The start record, one row.
void read_start(OpenRecord& record, RunData& data) {
  Statement row = record.select(
      "run", {"protocol", "title", "script", "operator", "parameters", "parameter_units", "seed",
              "versions", "rig", "devices", "files", "t0_utc_ns", "clock", "tags", "sample"});
  if (!row.step()) throw RecordError(data.folder.string() + ": its start record is missing");
  RunStart& start = data.start;
  start.protocol_file = row.text(0);
  start.protocol_title = row.text(1);
  start.protocol_text = row.text(2);
  start.operator_name = row.text(3);
  start.parameters = object_of(row.text(4));
  start.parameter_units = object_of(row.text(5));
  // A text in the record: SQLite's integers are signed, and a seed may have all 64 bits.
  start.seed = std::strtoull(row.text(6).c_str(), nullptr, 10);
  start.versions = object_of(row.text(7));
  start.rig = object_of(row.text(8));
  start.devices = object_of(row.text(9));
  start.files = object_of(row.text(10));
  if (!row.is_null(11)) start.t0_utc_ns = row.integer(11);
  start.clock = row.text(12);
  start.tags = object_of(row.text(13));
  start.sample = object_of(row.text(14));
}

/// Of each camera the number that a JSON object has under its name; 0 where it has none.
std::vector<std::uint64_t> by_camera(const RunData& data, const std::string& text) {
  const nlohmann::json json = object_of(text);
  std::vector<std::uint64_t> numbers;
  for (const RecordedCameraInfo& camera : data.cameras)
    numbers.push_back(json.is_object() && json.contains(camera.camera) &&
                              json[camera.camera].is_number_unsigned()
                          ? json[camera.camera].get<std::uint64_t>()
                          : 0);
  return numbers;
}

/// The end record, where there is one yet. After read_frames(): drops and losses are by camera.
void read_end(OpenRecord& record, RunData& data) {
  Statement row = record.select(
      "stop",
      {"exit_status", "reason", "experiment_time", "wall_time", "script_line", "dropped", "held",
       "lost", "ended_by", "ended_name", "ended_face", "ended_signal"},
      "LIMIT 1");
  if (!row.step()) return;
  const auto outcome = outcome_named(row.text(0));
  if (!outcome)
    throw RecordError(data.folder.string() + ": its end record names no outcome that is known");
  data.end =
      RunEnd{*outcome,    row.text(1), row.real(2),
             row.real(3), row.text(4), {row.text(8), row.text(9), row.text(10), row.text(11)}};
  // Drops belong to cameras by name in the file and by number in memory: hence the order of
  // read_run().
  data.dropped = by_camera(data, row.text(5));
  data.lost = by_camera(data, row.text(7));
  data.held = row.real(6);
}

/// NULL is NaN: SQLite has no NaN and stores one as NULL.
/// All of a stream is held in memory, as the recorder holds it: reports and exports need several
/// passes.
void read_samples(Database& database, Stream& stream, const std::string& table) {
  std::string columns;
  for (const Channel& channel : stream.info.channels)
    columns += ", " + quoted_identifier(channel.name);
  Statement rows = database.prepare("SELECT t_ns" + columns + " FROM " + quoted_identifier(table) +
                                    " ORDER BY seq");
  const int width = static_cast<int>(stream.info.channels.size());
  while (rows.step()) {
    stream.times.emplace_back(rows.integer(0));
    for (int i = 1; i <= width; ++i)
      stream.values.push_back(rows.is_null(i) ? std::numeric_limits<double>::quiet_NaN()
                                              : rows.real(i));
  }
}

// The statement of the channels runs once a stream: step() leaves it ready for the next binding.
void read_streams(OpenRecord& record, RunData& data) {
  Statement streams =
      record.select("stream", {"id", "name", "source", "sample_table", "clock"}, "ORDER BY id");
  Statement channels = record.select("channel", {"name", "unit", "help", "axes"},
                                     "WHERE stream=? ORDER BY position");
  while (streams.step()) {
    Stream stream;
    stream.info.name = streams.text(1);
    stream.info.source = streams.text(2);
    stream.info.clock = streams.text(4);
    channels.bind(1, streams.integer(0));
    while (channels.step())
      stream.info.channels.push_back(
          {channels.text(0), channels.text(1), channels.text(2), channels.text(3)});
    read_samples(record.database(), stream, streams.text(3));
    data.streams.push_back(std::move(stream));
  }
}

/// Calls `each` with every row of a statement.
template <class Each>
void rows_of(Statement rows, Each each) {
  while (rows.step()) each(rows);
}

std::vector<std::string> texts(const nlohmann::json& list) {
  std::vector<std::string> words;
  for (const nlohmann::json& one : list) words.push_back(one.get<std::string>());
  return words;
}

/// A path of the record that stays within the run's folder.
/// The folder may come from elsewhere: a report or an export made of it must not read a file of
/// this machine.
std::string inside(const RunData& data, const std::string& file) {
  const fs::path path(file);
  const bool climbs = std::find(path.begin(), path.end(), "..") != path.end();
  if (file.empty() || path.is_absolute() || climbs)
    throw RecordError(data.folder.string() + ": names a file outside itself: " + file);
  // Below the folder by its name, and by where its links lead.
  std::error_code error;
  const fs::path root = fs::canonical(data.folder, error);
  const fs::path place = fs::weakly_canonical(data.folder / path, error);
  if (error ||
      std::mismatch(root.begin(), root.end(), place.begin(), place.end()).first != root.end())
    throw RecordError(data.folder.string() + ": " + file +
                      ": is a link to a file outside the folder; put the file itself there");
  return file;
}

/// What came out: results, plots, drawings, tables, pictures.
/// In the order in which they were stated. A picture whose file is gone stays with its caption and
/// no bytes: the report is made all the same.
void read_results(OpenRecord& record, RunData& data) {
  rows_of(record.select(record.has_table("result") ? "result" : "figure", {"name", "value", "unit"},
                        "ORDER BY rowid"),
          [&](const Statement& row) {
            const double value =
                row.is_null(1) ? std::numeric_limits<double>::quiet_NaN() : row.real(1);
            data.results.push_back({row.text(0), value, row.text(2)});
          });
  rows_of(record.select("plot", {"content"}, "ORDER BY seq"),
          [&](const Statement& row) { data.plots.push_back(plot_from_json(parsed(row.text(0)))); });
  rows_of(record.select("drawing", {"title", "svg"}, "ORDER BY seq"), [&](const Statement& row) {
    data.drawings.push_back({row.text(0), row.text(1)});
  });
  rows_of(record.select("result_table", {"title", "header", "rows"}, "ORDER BY seq"),
          [&](const Statement& row) {
            Table table{row.text(0), texts(parsed(row.text(1))), {}};
            for (const nlohmann::json& one : parsed(row.text(2))) table.rows.push_back(texts(one));
            data.tables.push_back(std::move(table));
          });
  rows_of(record.select("picture", {"name", "caption", "file"}, "ORDER BY seq"),
          [&](const Statement& row) {
            const std::string file = inside(data, row.text(2));
            std::string bytes;
            if (fs::is_regular_file(data.folder / file))
              bytes = read_whole_file(data.folder / file);
            data.pictures.push_back({row.text(0), row.text(1), file,
                                     std::make_shared<PngImage>(
                                         std::vector<unsigned char>(bytes.begin(), bytes.end()))});
          });
}

void read_events(OpenRecord& record, RunData& data) {
  rows_of(record.select("event", {"t_ns", "kind", "text"}, "ORDER BY seq"),
          [&](const Statement& row) {
            data.events.push_back({Time(row.integer(0)), row.text(1), row.text(2)});
          });
  rows_of(record.select("module", {"name", "file", "text"}, "ORDER BY rowid"),
          [&](const Statement& row) {
            data.modules.push_back({row.text(0), row.text(1), row.text(2)});
          });
}

/// What passed on the links, where the run was asked for it.
void read_links(OpenRecord& record, RunData& data) {
  rows_of(record.select("link", {"t_ns", "role", "address", "event", "bytes"}, "ORDER BY seq"),
          [&](const Statement& row) {
            data.links.push_back(
                {Time(row.integer(0)), row.text(1), row.text(2), row.text(3), row.bytes(4)});
          });
}

/// Before version 4 every pixel had 8 bits, and images began with the sensor.
void read_cameras(OpenRecord& record, RunData& data) {
  rows_of(record.select("camera",
                        {"name", "identity", "every", "frame_period", "effective_pixel", "bits",
                         "offset_x_px", "offset_y_px"},
                        "ORDER BY rowid"),
          [&](const Statement& row) {
            data.cameras.push_back(
                {row.text(0), row.text(1), static_cast<int>(row.integer(2)), row.real(3),
                 row.real(4), row.is_null(5) ? 8 : static_cast<int>(row.integer(5)),
                 static_cast<int>(row.integer(6)), static_cast<int>(row.integer(7))});
          });
}

/// The rows alone: pixels stay on the disk until read_frame() asks for them.
void read_frames(OpenRecord& record, RunData& data) {
  rows_of(record.select("frame",
                        {"camera", "number", "t_ns", "t_received_ns", "t_device_ns", "file",
                         "offset", "bytes", "width_px", "height_px", "pixel_type", "crc32",
                         "dropped_before", "lost_before"},
                        "ORDER BY seq"),
          [&](const Statement& row) {
            FrameRow frame;
            frame.camera = row.text(0);
            frame.number = static_cast<std::uint64_t>(row.integer(1));
            frame.exposed = Time(row.integer(2));
            frame.received = Time(row.integer(3));
            if (!row.is_null(4)) frame.device = Time(row.integer(4));
            // Thousands of frames in one file: it is looked at once.
            frame.file = !data.frames.empty() && data.frames.back().file == row.text(5)
                             ? row.text(5)
                             : inside(data, row.text(5));
            frame.offset = static_cast<std::uint64_t>(row.integer(6));
            frame.bytes = static_cast<std::uint64_t>(row.integer(7));
            frame.width_px = static_cast<int>(row.integer(8));
            frame.height_px = static_cast<int>(row.integer(9));
            frame.pixel_type = static_cast<int>(row.integer(10));
            frame.crc32 = static_cast<std::uint32_t>(row.integer(11));
            frame.dropped_before = static_cast<std::uint64_t>(row.integer(12));
            frame.lost_before = static_cast<std::uint64_t>(row.integer(13));
            data.frames.push_back(std::move(frame));
          });
}

/// Names begin with the time to the second; among runs of one second the folder whose scripts were
/// stored last, which is the first that a run does.
fs::path newest(const std::vector<fs::path>& sorted) {
  constexpr std::size_t kSecond = std::string_view("2026-11-23T104601").size();
  const auto second = [](const fs::path& folder) {
    return folder.filename().string().substr(0, kSecond);
  };
  const auto stored = [](const fs::path& folder) {
    std::error_code error;
    return fs::last_write_time(folder / "script", error);
  };
  fs::path found = sorted.back();
  for (auto folder = sorted.rbegin(); folder != sorted.rend(); ++folder) {
    if (second(*folder) != second(sorted.back())) break;
    if (stored(*folder) > stored(found)) found = *folder;
  }
  return found;
}

// Whatever is wrong becomes a RecordError with the file's name.
// Each query sees what is committed at its own moment: of a run that goes on, frames may be newer
// than samples by a commit.
RunData read_with(const fs::path& folder,
                  const std::function<void(OpenRecord&, RunData&)>& read_rest) {
  RunData data;
  data.folder = folder;
  try {
    OpenRecord record(folder);
    data.version = record.version();
    read_start(record, data);
    read_rest(record, data);
    read_end(record, data);
    read_results(record, data);
  } catch (const RecordError&) {
    throw;
  } catch (const nlohmann::json::exception& error) {
    throw RecordError((folder / "run.sqlite").string() +
                      ": a text in it is broken: " + error_words(error));
  } catch (const std::exception& error) {
    throw RecordError(error.what());
  }
  return data;
}

}  // namespace

// No record is opened: a list of thousands is quick, and has those that cannot be read too.
std::vector<fs::path> run_folders(const fs::path& parent) {
  std::vector<fs::path> folders;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(parent, error))
    if (entry.is_directory(error) && fs::exists(entry.path() / "run.sqlite", error))
      folders.push_back(entry.path());
  std::sort(folders.begin(), folders.end());  // the names begin with the time
  return folders;
}

// In this order: a path, "last", a whole name, the beginning of exactly one name.
// Never a guess between two: the run that is meant may be recovered or exported next.
fs::path find_run(const std::string& word, const fs::path& parent) {
  if (fs::exists(fs::path(word) / "run.sqlite")) return fs::path(word);
  const std::vector<fs::path> folders = run_folders(parent);
  if (word == "last") {
    if (folders.empty()) throw RecordError("there are no runs in " + parent.string());
    return newest(folders);
  }
  std::vector<std::string> matching;
  for (const fs::path& folder : folders) {
    const std::string name = folder.filename().string();
    if (name == word) return folder;
    if (!word.empty() && name.starts_with(word)) matching.push_back(name);
  }
  if (matching.size() == 1) return parent / matching.front();
  if (matching.empty())
    throw RecordError(word + ": is no run's folder, and no run in " + parent.string() +
                      " begins so");
  const std::size_t count = matching.size();
  matching.resize(std::min(count, kShownCandidates));
  throw RecordError(fmt::format("{}: could be {} runs: {}{}", word, count,
                                fmt::join(matching, ", "),
                                count > kShownCandidates ? ", ..." : ""));
}

// Rows and pixels are independent witnesses: the size by the row must be that by width, height and
// type, or the row is not believed.
cv::Mat read_frame(const RunData& data, const FrameRow& row) {
  NdtiffEntry entry;
  entry.file = row.file;
  entry.pixels_at = row.offset;
  entry.width_px = row.width_px;
  entry.height_px = row.height_px;
  entry.pixel_type = row.pixel_type;
  // A broken row must not ask for an absurd amount of memory.
  constexpr int kLargest = 1 << 16;  // px
  const bool sensible = row.width_px > 0 && row.height_px > 0 && row.width_px <= kLargest &&
                        row.height_px <= kLargest && row.pixel_type >= 0 && row.pixel_type <= 2;
  if (!sensible || entry.pixel_bytes() != row.bytes)
    throw RecordError(
        fmt::format("{}: the row of frame {} is broken", data.folder.string(), row.number));
  return read_ndtiff_image(data.folder, entry);
}

RunData read_run(const fs::path& folder) {
  return read_with(folder, [](OpenRecord& record, RunData& data) {
    read_streams(record, data);
    read_cameras(record, data);
    read_frames(record, data);
    read_events(record, data);
    read_links(record, data);
  });
}

// The cameras are a row each, which the end's counts of frames belong to.
RunData read_outline(const fs::path& folder) { return read_with(folder, read_cameras); }

}  // namespace vitreo
