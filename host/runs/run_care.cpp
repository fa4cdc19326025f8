// SPDX-License-Identifier: Apache-2.0
#include "host/runs/run_care.h"

#include "host/files/digest.h"
#include "host/files/manifest.h"
#include "host/files/ndtiff.h"
#include "host/files/run_folder.h"
#include "host/files/sqlite.h"
#include "host/record/data_sheet.h"
#include "host/record/record_json.h"
#include "host/record/recorder.h"
#include "host/record/run_lock.h"
#include "host/runs/open_record.h"
#include "host/runs/report.h"
#include "host/runs/run_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kProblemsShown = 100;

/// Collects problems, a bounded number of them: a broken disk has thousands.
class Findings {
 public:
  explicit Findings(std::vector<std::string>& problems) : problems_(problems) {}
  void add(const std::string& problem) {
    if (problems_.size() < kProblemsShown)
      problems_.push_back(problem);
    else if (problems_.size() == kProblemsShown)
      problems_.push_back("and more");
  }
  template <class Action>
  void attempt(Action action) {
    try {
      action();
    } catch (const std::exception& error) {
      add(error.what());
    }
  }

 private:
  std::vector<std::string>& problems_;
};

/// SQLite's own integrity check, one end record, and as many samples as that counted, without gaps
/// in their numbers.
/// Opened again and not through read_run(), which fails at the first broken text: here each fault
/// is a line of its own. The largest seq equals the count only where no row is missing in between.
void check_database(const fs::path& folder, Findings& findings) {
  Database database((folder / "run.sqlite").string(), Database::Mode::read_only);
  Statement check = database.prepare("PRAGMA integrity_check");
  while (check.step())
    if (check.text(0) != "ok") findings.add("run.sqlite: " + check.text(0));
  Statement stops = database.prepare("SELECT count(*), coalesce(max(counts), '') FROM stop");
  if (!stops.step() || stops.integer(0) == 0)
    return findings.add(
        RunLock::is_held(folder)
            ? "run.sqlite: the run is being recorded"
            : "run.sqlite: no end record: the run was lost; vitreo recover ends it");
  if (stops.integer(0) > 1) findings.add("run.sqlite: more than one end record");
  const nlohmann::json counts = nlohmann::json::parse(stops.text(1), nullptr, false);
  if (!counts.is_object()) return findings.add("run.sqlite: the end record has no counts");
  for (const auto& [stream, count] : counts.items()) {
    Statement rows = database.prepare("SELECT count(*), coalesce(max(seq), 0) FROM " +
                                      quoted_identifier("sample_" + stream));
    rows.step();
    if (!count.is_number_integer() || rows.integer(0) != count.get<std::int64_t>() ||
        rows.integer(0) != rows.integer(1))
      findings.add(fmt::format("stream {}: {} samples are there, the end record counted {}", stream,
                               rows.integer(0), dumped(count)));
  }
}

// Equal times are no fault: several samples of one stream may belong to one moment.
void check_streams(const RunData& data, Findings& findings, RunCheck& verdict) {
  for (const Stream& stream : data.streams) {
    verdict.samples += stream.times.size();
    if (!std::is_sorted(stream.times.begin(), stream.times.end()))
      findings.add("stream " + stream.info.name + ": its times go back");
  }
}

/// Every recorded image against its CRC-32, and each camera's numbers rising.
/// Numbers may have gaps, for drops are allowed and counted; they never repeat or go back within a
/// camera.
void check_frames(const RunData& data, Findings& findings, RunCheck& verdict) {
  std::map<std::string, std::uint64_t> last;
  for (const FrameRow& row : data.frames) {
    ++verdict.frames;
    const fs::path file = data.folder / row.file;
    const std::string name = fmt::format("{} frame {}", row.camera, row.number);
    if (const auto before = last.find(row.camera);
        before != last.end() && row.number <= before->second)
      findings.add(name + ": comes after frame " + std::to_string(before->second));
    last[row.camera] = row.number;
    findings.attempt([&] {
      const cv::Mat image = read_frame(data, row);
      if (crc32(image.data, row.bytes) != row.crc32)
        findings.add(name + ": its pixels have changed");
    });
    if (verdict.problems.size() > kProblemsShown) return;
  }
}

/// Frames that were whole in their stacks when the program died, but not yet named by a row.
/// Rows are written in the order of the stack, so those that are missing are the last of each
/// camera; mend_ndtiff() drops what a crash left incomplete. Number and times come from the image's
/// metadata.
std::size_t name_frames(Database& database, const RunData& data) {
  std::size_t named = 0;
  std::int64_t seq = static_cast<std::int64_t>(data.frames.size());
  for (const RecordedCameraInfo& camera : data.cameras) {
    const std::string below = "frames/" + slug(camera.camera, "camera");
    if (!fs::exists(data.folder / below / "NDTiff.index")) continue;
    // It cuts the files: the folder's lock is held by recover_run(), so that no recorder writes
    // them.
    const std::vector<NdtiffEntry> entries = mend_ndtiff(data.folder / below);
    const auto known =
        std::count_if(data.frames.begin(), data.frames.end(),
                      [&](const FrameRow& row) { return row.camera == camera.camera; });
    for (std::size_t i = static_cast<std::size_t>(known); i < entries.size(); ++i, ++named) {
      const NdtiffEntry& entry = entries[i];
      const nlohmann::json about = read_ndtiff_metadata(data.folder / below, entry);
      // The CRC-32 is of what is on the disk now: it cannot vouch for the moment of recording, only
      // for the time from here on.
      const cv::Mat image = read_ndtiff_image(data.folder / below, entry);
      Statement insert =
          insert_into(database, "frame",
                      {"seq", "camera", "number", "t_ns", "t_received_ns", "t_device_ns", "file",
                       "offset", "bytes", "width_px", "height_px", "pixel_type", "crc32",
                       "dropped_before", "lost_before"});
      insert.bind(1, ++seq).bind(2, camera.camera).bind(3, about.value("Number", std::int64_t{0}));
      insert.bind(4, about.value("Exposed-ns", std::int64_t{0}))
          .bind(5, about.value("Received-ns", std::int64_t{0}));
      if (about.contains("Device-ns")) insert.bind(6, about.value("Device-ns", std::int64_t{0}));
      insert.bind(7, below + "/" + entry.file).bind(8, static_cast<std::int64_t>(entry.pixels_at));
      insert.bind(9, static_cast<std::int64_t>(entry.pixel_bytes()))
          .bind(10, std::int64_t{entry.width_px});
      insert.bind(11, std::int64_t{entry.height_px}).bind(12, std::int64_t{entry.pixel_type});
      insert.bind(13, std::int64_t{crc32(image.data, entry.pixel_bytes())});
      insert.bind(14, about.value("DroppedBefore", std::int64_t{0}));
      insert.bind(15, about.value("LostBefore", std::int64_t{0})).run();
    }
  }
  return named;
}

/// The end record of a run that has none; its time is that of the last sample.
/// Counts are of what is there, so that `vitreo verify` holds the recovered run to it. Drops and
/// waits are not known any more: none are stated.
void write_lost(Database& database, const RunData& data) {
  nlohmann::json counts = nlohmann::json::object();
  Time last{};
  for (const Stream& stream : data.streams) {
    counts[stream.info.name] = stream.times.size();
    if (!stream.times.empty()) last = std::max(last, stream.times.back());
  }
  insert_into(database, "stop",
              {"time", "exit_status", "reason", "script_line", "experiment_time", "wall_time",
               "counts", "dropped", "held", "lost"})
      .bind(1, wall_time_text())
      .bind(2, std::string_view(to_string(Outcome::lost)))
      .bind(3, std::string_view(
                   "the program ended without an end record: killed, crashed, or the power failed"))
      .bind(4, std::string_view(""))
      .bind(5, to_seconds(last))
      .bind(6, 0.0)
      .bind(7, dumped(counts))
      .bind(8, std::string_view("{}"))
      .bind(9, 0.0)
      .bind(10, std::string_view("{}"))
      .run();
}

/// The files that are made of the record, and their hashes last.
/// write_manifest() last, since it hashes the two others.
void write_outputs(const RunData& data) {
  try {
    write_file(data.folder / "report.html", report_html(data));
  } catch (const std::logic_error& error) {  // a plot that this program would not have recorded
    throw RecordError((data.folder / "run.sqlite").string() + ": " + error.what());
  }
  write_file(data.folder / kDataSheet, data_sheet(data));
  write_file(data.folder / "summary.json",
             summary(data).dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  write_manifest(data.folder);
}

}  // namespace

// Of a run that is being recorded no hashes: its files change.
RunCheck verify_run(const fs::path& folder) {
  RunCheck verdict;
  Findings findings(verdict.problems);
  if (!fs::is_regular_file(folder / "run.sqlite")) {
    findings.add("run.sqlite: is missing");
    return verdict;
  }
  const bool recording = RunLock::is_held(folder);
  // The other checks hold for a run that goes on too: the database is consistent at every commit,
  // and frames that have a row are whole.
  if (!recording)
    findings.attempt([&] {
      for (const std::string& problem : check_manifest(folder)) findings.add(problem);
      verdict.files = count_files(folder);
    });
  findings.attempt([&] { check_database(folder, findings); });
  findings.attempt([&] {
    const RunData data = read_run(folder);
    check_streams(data, findings, verdict);
    check_frames(data, findings, verdict);
  });
  return verdict;
}

/// All rows in one transaction: a second death while recovering leaves what was there.
Recovery recover_run(const fs::path& folder) {
  Recovery recovery;
  RunLock lock(folder);  // first: a run that goes on is left alone
  try {
    RunData data = read_run(folder);
    recovery.was_closed = data.end.has_value();
    {
      // Opening it replays the WAL that the dead program left. Back to a rollback journal then, as
      // RecordFile::close() leaves it.
      Database database((folder / "run.sqlite").string(), Database::Mode::read_write);
      database.execute("BEGIN IMMEDIATE");
      recovery.frames_named = name_frames(database, data);
      if (!data.end) write_lost(database, data);
      database.execute("COMMIT");
      database.execute("PRAGMA wal_checkpoint(TRUNCATE)");
      database.execute("PRAGMA journal_mode=DELETE");
      database.close();
    }
    std::error_code ignored;  // it may have gone with the end record
    fs::remove(folder / "reserve.room", ignored);
    // Once more: the report is made of what the file now says, and not of what was believed to have
    // been written.
    data = read_run(folder);
    write_outputs(data);
  } catch (const RecordError&) {
    throw;
  } catch (const std::exception& error) {
    throw RecordError(error.what());
  }
  return recovery;
}

// Only of a run that has ended: the manifest would be wrong with the next row.
void report_run(const fs::path& folder) {
  const RunData data = read_run(folder);
  if (!data.end)
    throw RecordError(folder.string() +
                      ": has no end yet; vitreo recover ends a run that was lost");
  write_outputs(data);
}

}  // namespace vitreo
