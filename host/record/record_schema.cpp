// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_schema.h"

#include <stdexcept>
#include <string_view>

namespace vitreo {
namespace {

// SQLite's storage classes. A key of this type is the table's rowid: rows are found by it without
// an index.
constexpr const char* kKey = "INTEGER PRIMARY KEY";
constexpr const char* kInteger = "INTEGER";
constexpr const char* kReal = "REAL";
constexpr const char* kText = "TEXT";

// In the order of DATA.md; readers in other languages find the tables by these names.
constexpr RecordTable kTables[] = {
    {"run", "the start record, one row: what was asked of the run, by whom, on what"},
    {"module", "each Lua file that the scripts required, as it was then"},
    {"stream", "the streams of samples; the samples of each are in a table of its own"},
    {"channel", "the channels of the streams: the columns of the tables sample_NAME"},
    {"camera", "the cameras whose frames are recorded"},
    {"frame", "a row a recorded frame: its times, and where its pixels are"},
    {"event", "what happened, in order"},
    {"result", "the numbers that the run states as its results"},
    {"plot", "the plots of the report, as data"},
    {"drawing", "drawings of the report that are no plots"},
    {"picture", "the pictures of the report"},
    {"result_table", "the tables of the report"},
    {"stop", "the end record, one row; none while the run goes on, or when its program died"},
    {"meaning", "what is meant by the names in this record"},
    {"link", "what passed between the host and its instruments (only of a run that traced it)"},
};

constexpr const char* kSeq = "the row's number, from 1";
constexpr const char* kRunTime = "when, on the run's clock; UTC is run.t0_utc_ns plus it";

// The rows of a table stand together, and in the order of its columns: create_table() takes them
// so. A new column raises kRecordVersion and leaves the others where they are.
constexpr RecordColumn kColumns[] = {
    {"run", "uid", kText, "", "identifier of this run, random, 32 hexadecimal digits"},
    {"run", "time", kText, "", "when it began: ISO 8601, local time with its offset from UTC"},
    {"run", "protocol", kText, "", "file of the protocol"},
    {"run", "title", kText, "", "title of the protocol"},
    {"run", "script", kText, "", "text of the protocol as it was run"},
    {"run", "script_hash", kText, "", "SHA-256 of the column script"},
    {"run", "operator", kText, "", "who ran it"},
    {"run", "parameters", kText, "", "JSON, name: value; numbers are in SI units"},
    {"run", "parameter_units", kText, "",
     "JSON, name: unit as the protocol declares it, in which the value is shown (the value itself "
     "is in the SI unit of the same dimension); empty or missing: a plain number or a text"},
    // A text, as SQLite's integers have a sign: 2^63 and above would not fit.
    {"run", "seed", kText, "", "seed of all that was drawn by chance, a whole number below 2^64"},
    {"run", "versions", kText, "", "JSON, name: version of the program and its libraries"},
    {"run", "rig", kText, "",
     "JSON: file and text of the rig file, those it builds on (bases, instruments), and resolved: "
     "every setting as it was used, in SI units"},
    {"run", "rig_hash", kText, "", "SHA-256 of the column rig"},
    {"run", "devices", kText, "", "JSON, role: what the instrument said that it is"},
    {"run", "files", kText, "", "JSON, file that the rig names: its SHA-256"},
    {"run", "t0_utc_ns", kInteger, "ns",
     "UTC, since 1970-01-01T00:00:00Z without leap seconds, at which the run's clock was 0"},
    {"run", "clock", kText, "", "what the run's clock is: real or virtual (meaning, kind time)"},
    {"run", "tags", kText, "", "JSON, key: text that was given with --tag or by the script"},
    {"run", "sample", kText, "",
     "JSON, of the sample: eye (its id), species, age (of the animal or donor), died, removed "
     "(when the "
     "animal died, when the eye was removed, ISO 8601 UTC), pipette (that inserts the robot), "
     "light (lamp, "
     "level, way into the eye), robot (its id); what is not known is missing"},
    {"module", "name", "TEXT PRIMARY KEY", "", "name under which it was required"},
    {"module", "file", kText, "", "file from which it was read"},
    {"module", "hash", kText, "", "SHA-256 of the column text"},
    {"module", "text", kText, "", "its text as it was run"},
    {"stream", "id", kKey, "", "number of the stream"},
    {"stream", "name", "TEXT UNIQUE", "", "name of the stream"},
    {"stream", "source", kText, "", "what it was measured by, or computed from"},
    {"stream", "sample_table", kText, "", "table of its samples"},
    {"stream", "clock", kText, "",
     "to which instant t_ns of its rows belongs (meaning, kind clock)"},
    {"channel", "stream", "INTEGER REFERENCES stream(id)", "", "number of its stream"},
    {"channel", "position", kInteger, "", "place among the stream's channels, from 0"},
    {"channel", "name", kText, "", "name of the channel: the column of the sample table"},
    {"channel", "unit", kText, "", "SI unit, px, or 1 for a plain number"},
    {"channel", "help", kText, "", "what it is"},
    {"channel", "axes", kText, "",
     "frame of axes of a position, a direction or a pixel (meaning, kind axes); empty for others"},
    {"camera", "name", "TEXT PRIMARY KEY", "", "role of the camera"},
    {"camera", "identity", kText, "", "what the camera said that it is"},
    {"camera", "every", kInteger, "1", "each so manieth frame was recorded"},
    {"camera", "frame_period", kReal, "s", "time between two exposures"},
    {"camera", "effective_pixel", kReal, "m",
     "width of a pixel in the observed plane (the aerial image, of a microscope on the eye)"},
    {"camera", "bits", kInteger, "1", "so many bits of a pixel count, the low ones"},
    {"camera", "offset_x_px", kInteger, "px", "column of the image's first pixel on the sensor"},
    {"camera", "offset_y_px", kInteger, "px", "row of the image's first pixel on the sensor"},
    // Three times a row: of the exposure and of its arrival on the run's clock, and of the exposure
    // on the camera's own, which may drift from it.
    {"frame", "seq", kKey, "1", kSeq},
    {"frame", "camera", kText, "", "role of the camera"},
    {"frame", "number", kInteger, "1",
     "the camera's own count of its exposures: it has holes where frames are missing"},
    {"frame", "t_ns", kInteger, "ns", "middle of the exposure, on the run's clock"},
    {"frame", "t_received_ns", kInteger, "ns", "when the host had the frame, on the run's clock"},
    {"frame", "t_device_ns", kInteger, "ns",
     "middle of the exposure on the camera's own clock, where it has one"},
    {"frame", "file", kText, "", "file with its pixels, below this folder"},
    {"frame", "offset", kInteger, "byte", "where its pixels begin in the file"},
    {"frame", "bytes", kInteger, "byte", "size of its pixels, row by row, uncompressed"},
    {"frame", "width_px", kInteger, "px", "pixels in a row"},
    {"frame", "height_px", kInteger, "px", "rows"},
    {"frame", "pixel_type", kInteger, "", "0: 8 bit gray, 1: 16 bit gray, 2: 8 bit color"},
    {"frame", "crc32", kInteger, "", "CRC-32 of the image as the camera gave it"},
    // Two causes of a gap, with two cures: a disk that is too slow, and a host or a line that is.
    {"frame", "dropped_before", kInteger, "1",
     "frames that the host had and did not record, as the disk was behind, since the row before"},
    {"frame", "lost_before", kInteger, "1",
     "frames that the camera exposed, by its count, and that never came to the host or were not "
     "taken in time, since the row before"},
    {"event", "seq", kKey, "1", kSeq},
    {"event", "t_ns", kInteger, "ns", kRunTime},
    {"event", "kind", kText, "", "kind of event: note, alarm, checkpoint, question, error ..."},
    {"event", "text", kText, "", "its words, or JSON"},
    {"result", "name", "TEXT PRIMARY KEY", "", "name of the result"},
    {"result", "value", kReal, "", "its value, in the SI unit of the column unit's dimension"},
    {"result", "unit", kText, "", "unit in which it is shown; the value is SI all the same"},
    {"plot", "seq", kKey, "1", kSeq},
    {"plot", "title", kText, "", "title of the plot"},
    {"plot", "content", kText, "", "JSON: axes with label and SI unit, series with x and y"},
    {"drawing", "seq", kKey, "1", kSeq},
    {"drawing", "title", kText, "", "title of the drawing"},
    {"drawing", "svg", kText, "", "the drawing, SVG"},
    {"picture", "seq", kKey, "1", kSeq},
    {"picture", "name", kText, "", "name of the picture"},
    {"picture", "caption", kText, "", "its caption"},
    {"picture", "file", kText, "", "its file, below this folder"},
    {"result_table", "seq", kKey, "1", kSeq},
    {"result_table", "title", kText, "", "title of the table"},
    {"result_table", "header", kText, "", "JSON: the heads of its columns, with units"},
    {"result_table", "rows", kText, "", "JSON: its rows as they are shown"},
    {"stop", "time", kText, "", "when it ended: ISO 8601, local time with its offset from UTC"},
    {"stop", "exit_status", kText, "", "completed, failed, stopped, aborted or lost"},
    {"stop", "reason", kText, "", "why, one line; empty when completed"},
    {"stop", "script_line", kText, "", "file:line where the script was"},
    {"stop", "experiment_time", kReal, "s", "how long it took on the run's clock"},
    {"stop", "wall_time", kReal, "s", "how long it took on the wall clock"},
    {"stop", "counts", kText, "", "JSON, stream: number of its samples"},
    {"stop", "dropped", kText, "",
     "JSON, camera: frames that the host had and did not record, as the disk was behind"},
    {"stop", "held", kReal, "s", "for so long the recorder held up the run"},
    {"stop", "lost", kText, "",
     "JSON, camera: frames that the camera exposed, by its count, and that never came to the host "
     "or were not taken in time, while its frames were recorded"},
    // Four columns of one cause (EndCause): empty where it does not apply.
    {"stop", "ended_by", kText, "",
     "who or what ended it: protocol (it came to its end, or to its own error), script (it asked "
     "for the end), person, scheduler (of a cluster), signal, device, interlock, watchdog, "
     "recorder, program; nothing: not known"},
    {"stop", "ended_name", kText, "", "name of that person, device, scheduler or sender"},
    {"stop", "ended_face", kText, "",
     "where a person asked for it: the terminal, the control socket, the live view"},
    {"stop", "ended_signal", kText, "",
     "the signal that asked for it: SIGINT, SIGTERM, SIGHUP, SIGQUIT"},
    {"meaning", "kind", kText, "", "kind of name: file, table, column, clock, time, axes"},
    {"meaning", "name", kText, "", "the name; of a column TABLE.COLUMN"},
    {"meaning", "unit", kText, "", "unit of a column"},
    {"meaning", "text", kText, "", "what is meant by it"},
    {"link", "seq", kKey, "1", kSeq},
    {"link", "t_ns", kInteger, "ns", kRunTime},
    {"link", "role", kText, "", "role of the instrument"},
    {"link", "address", kText, "", "where the instrument is"},
    {"link", "event", kText, "", "to or from the instrument, opened, cleared or failed"},
    // Not a text: what passes on a line need not be UTF-8, and may hold zeros.
    {"link", "bytes", "BLOB", "", "the bytes; of failed the error's text"},
};

}  // namespace

std::span<const RecordTable> record_tables() { return kTables; }
std::span<const RecordColumn> record_columns() { return kColumns; }

std::string create_table(const std::string& table) {
  std::string columns;
  for (const RecordColumn& column : kColumns)
    if (table == column.table)
      // The names are this file's own words and need no quotes.
      columns += (columns.empty() ? "" : ", ") + std::string(column.name) + " " + column.type;
  if (columns.empty()) throw std::logic_error("run.sqlite has no table " + table);
  return "CREATE TABLE IF NOT EXISTS " + table + "(" + columns + ");";
}

std::string create_tables() {
  std::string sql;
  for (const RecordTable& table : kTables)
    // An empty table `link` would say that a traced line was silent.
    if (std::string_view(table.name) != "link") sql += create_table(table.name);
  return sql;
}

}  // namespace vitreo
