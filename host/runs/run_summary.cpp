// SPDX-License-Identifier: Apache-2.0
#include "host/runs/run_summary.h"

#include "host/record/record_json.h"
#include "host/record/run_lock.h"
#include "host/runs/open_record.h"
#include "host/text/units.h"

#include <exception>
#include <limits>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

// Of one run in the index: ten thousand runs stay below 100 MB.
constexpr std::size_t kLongestWords = 8192;  // bytes

/// Empty for what is none: a damaged column costs its values and not the run.
nlohmann::json json_object_of(const std::string& text) {
  nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  return json.is_object() ? json : nlohmann::json::object();
}

/// Without an end record: running as long as a process holds the folder's lock, else lost.
/// The lock and not the age of the files decides: a run may wait an hour for its operator without
/// writing.
void read_stop(OpenRecord& record, const fs::path& folder, RunSummary& run) {
  Statement stop = record.select(
      "stop", {"exit_status", "reason", "experiment_time", "wall_time", "ended_by"}, "LIMIT 1");
  if (!stop.step()) {
    run.head.state = RunLock::is_held(folder) ? "running" : "lost";
    return;
  }
  run.head.state = stop.text(0);
  run.head.reason = stop.text(1);
  run.head.experiment_time = stop.real(2);
  run.wall_time = stop.real(3);
  run.head.ended_by = stop.text(4);
  // A closed record has no write-ahead log: its files do not change any more, so the index may keep
  // what it has read.
  std::error_code error;
  run.lasting = !fs::exists(folder / "run.sqlite-wal", error);
}

NamedValue value_of(char kind, const std::string& name, const nlohmann::json& value,
                    const std::string& unit) {
  NamedValue made{kind, name, std::nullopt, "", ""};
  if (value.is_number()) {
    made.number = value.get<double>();
    made.unit = unit;
  } else if (value.is_boolean()) {
    // Both: a query may ask for = true as well as for > 0.
    made.number = value.get<bool>() ? 1 : 0;
    made.text = value.get<bool>() ? "true" : "false";
  } else {
    made.text = value.is_string() ? value.get<std::string>() : dumped(value);
    // A list keeps its unit for display; it is compared as a text.
    if (value.is_array()) made.unit = unit;
  }
  return made;
}

void read_start(OpenRecord& record, const fs::path& folder, RunSummary& run) {
  Statement row = record.select(
      "run", {"time", "protocol", "title", "operator", "seed", "parameters", "parameter_units",
              "json_extract(rig, '$.file')", "t0_utc_ns", "tags", "sample"});
  // Written first of all: without it the folder is no run, or one that was cut off at once.
  if (!row.step()) throw RecordError(folder.string() + ": its start record is missing");
  RunHead& head = run.head;
  head.time = row.text(0);
  head.protocol = row.text(1);
  head.title = row.text(2);
  head.operator_name = row.text(3);
  head.seed = row.text(4);
  head.rig = row.text(7);
  if (!row.is_null(8)) run.t0_utc_ns = row.integer(8);
  // In names of their own: a temporary object would be gone while its items are walked through.
  const nlohmann::json units = json_object_of(row.text(6));
  const nlohmann::json parameters = json_object_of(row.text(5));
  for (const auto& [name, value] : parameters.items()) {
    const auto unit = units.find(name);
    // Old records have no units of parameters.
    const bool known = unit != units.end() && unit->is_string();
    run.values.push_back(
        value_of('p', name, value, known ? si_unit(unit->get<std::string>()) : ""));
  }
  const nlohmann::json tags = json_object_of(row.text(9));
  for (const auto& [name, value] : tags.items())
    run.values.push_back(value_of('t', name, value, ""));
  const nlohmann::json sample = json_object_of(row.text(10));
  for (const auto& [name, value] : sample.items())
    run.values.push_back(value_of('s', name, value, ""));
}

/// The table was called `figure` in older records. SQLite stores a NaN as NULL.
void read_results(OpenRecord& record, RunSummary& run) {
  Statement row = record.select(record.has_table("result") ? "result" : "figure",
                                {"name", "value", "unit"}, "ORDER BY rowid");
  while (row.step())
    run.values.push_back({'r', row.text(0),
                          row.is_null(1) ? std::numeric_limits<double>::quiet_NaN() : row.real(1),
                          "", si_unit(row.text(2))});
}

/// What a person would search for: the texts of the head, tags and sample, and the notes.
void gather_words(OpenRecord& record, RunSummary& run) {
  const RunHead& head = run.head;
  for (const std::string& text :
       {head.title, head.protocol, head.operator_name, head.rig, head.reason})
    run.words += text + "\n";
  for (const NamedValue& one : run.values)
    if (one.kind == 't' || one.kind == 's') run.words += one.name + " " + one.text + "\n";
  Statement notes = record.select("event", {"text"}, "WHERE kind IN ('note', 'alarm')");
  // One more note than fits may be read: it is cut below.
  while (notes.step() && run.words.size() < kLongestWords) run.words += notes.text(0) + "\n";
  if (run.words.size() <= kLongestWords) return;
  // Not within a character of UTF-8.
  std::size_t end = kLongestWords;
  while (end > 0 && (static_cast<unsigned char>(run.words[end]) & 0xC0) == 0x80) --end;
  run.words.resize(end);
}

}  // namespace

// The error becomes the row's text, so that one broken folder does not end a list.
RunSummary read_summary(const fs::path& folder) {
  RunSummary run;
  run.head.folder = folder.string();
  try {
    OpenRecord record(folder);
    run.version = record.version();
    read_start(record, folder, run);
    read_stop(record, folder, run);
    read_results(record, run);
    gather_words(record, run);
  } catch (const std::exception& error) {
    run.head.state = "unreadable";
    run.head.reason = error.what();
    run.lasting = false;
  }
  return run;
}

RunHead read_head(const fs::path& folder) { return read_summary(folder).head; }

}  // namespace vitreo
