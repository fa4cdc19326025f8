// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_file.h"

#include "host/files/digest.h"
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"
#include "host/record/meaning.h"
#include "host/record/record_json.h"
#include "host/record/record_schema.h"

#include <exception>
#include <set>
#include <utility>

namespace vitreo {
namespace {

// A commit costs far more than a row, and readers see what is committed. Together with the writer's
// naps these keep the promise that what is a second old is on the disk.
constexpr auto kCommitAfter = std::chrono::milliseconds(100);
constexpr auto kSyncAfter = std::chrono::milliseconds(400);
constexpr int kCommitRows = 1000;

std::int64_t whole(std::size_t number) { return static_cast<std::int64_t>(number); }

/// What a power cut must not take: for these a commit waits for the disk.
/// Waiting for the disk takes milliseconds: for what explains an accident it is worth them.
bool is_grave(const std::string& kind) {
  static const std::set<std::string> kGrave = {"alarm", "interlock",    "unsafe",
                                               "lost",  "servo failed", "error"};
  return kGrave.count(kind) > 0;
}

}  // namespace

// One transaction for tables and start record: a file is a whole record or none.
RecordFile::RecordFile(const std::filesystem::path& file, const RunStart& start)
    : wal_(file.string() + "-wal"), database_(file.string(), Database::Mode::create) {
  // ms: another program that writes into it for a moment ends no run.
  database_.execute("PRAGMA busy_timeout=5000");
  // WAL: readers never block the writer. FULL: a commit waits for the disk; NORMAL: it does not,
  // and a power cut may take the last commits but never breaks the file (sqlite.org/pragma.html).
  database_.execute("PRAGMA journal_mode=WAL");
  database_.execute("PRAGMA synchronous=FULL");
  begin();
  database_.execute(create_tables());
  write_meanings();
  write_start(start);
  commit();
  database_.execute("PRAGMA synchronous=NORMAL");
}

void RecordFile::write_meanings() {
  Statement insert = database_.prepare("INSERT INTO meaning VALUES(?,?,?,?)");
  for (const Meaning& one : meanings())
    insert.bind(1, one.kind).bind(2, one.name).bind(3, one.unit).bind(4, one.text).run();
}

// The hash of the rig is of the text that is stored beside it, so that a reader can check it
// without this program. Wall clock and random uid differ in every run of a seed: the canonical
// export leaves this table out.
void RecordFile::write_start(const RunStart& start) {
  database_.execute("PRAGMA user_version=" + std::to_string(kRecordVersion));
  Statement insert =
      database_.prepare("INSERT INTO run VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)");
  if (start.t0_utc_ns) insert.bind(16, *start.t0_utc_ns);
  insert.bind(1, random_hex(32))
      .bind(2, wall_time_text())
      .bind(3, start.protocol_file)
      .bind(4, start.protocol_title)
      .bind(5, start.protocol_text)
      .bind(6, sha256(start.protocol_text))
      .bind(7, start.operator_name)
      .bind(8, dumped(start.parameters))
      .bind(9, dumped(start.parameter_units))
      .bind(10, std::to_string(start.seed))  // text: SQLite's integers end at 2^63
      .bind(11, dumped(start.versions))
      .bind(12, dumped(start.rig))
      .bind(13, sha256(dumped(start.rig)))
      .bind(14, dumped(start.devices))
      .bind(15, dumped(start.files))
      .bind(17, start.clock)
      .bind(18, dumped(start.tags.is_null() ? nlohmann::json::object() : start.tags))
      .bind(19, dumped(start.sample.is_null() ? nlohmann::json::object() : start.sample))
      .run();
}

/// A wide table a stream, a column a channel, so that common tools plot it without joins.
void RecordFile::add_stream(const StreamInfo& info) {
  const std::string table = quoted_identifier("sample_" + info.name);
  std::string columns = "seq INTEGER PRIMARY KEY, t_ns INTEGER NOT NULL";
  std::string parameters = "?,?";
  for (const Channel& channel : info.channels) {
    columns += ", " + quoted_identifier(channel.name) + " REAL";
    parameters += ",?";
  }
  begin();
  database_.execute("CREATE TABLE " + table + "(" + columns + ")");
  const auto id = whole(inserts_.size());
  database_.prepare("INSERT INTO stream VALUES(?,?,?,?,?)")
      .bind(1, id)
      .bind(2, info.name)
      .bind(3, info.source)
      .bind(4, "sample_" + info.name)
      .bind(5, info.clock)
      .run();
  Statement insert = database_.prepare("INSERT INTO channel VALUES(?,?,?,?,?,?)");
  for (std::size_t i = 0; i < info.channels.size(); ++i) {
    insert.bind(1, id)
        .bind(2, whole(i))
        .bind(3, info.channels[i].name)
        .bind(4, info.channels[i].unit)
        .bind(5, info.channels[i].help)
        .bind(6, info.channels[i].axes)
        .run();
  }
  // A stream's tables are on their way at once: readers find the stream before its first row.
  commit();
  // A row that is there already is the same row: see write_again().
  inserts_.push_back(
      database_.prepare("INSERT OR IGNORE INTO " + table + " VALUES(" + parameters + ")"));
  widths_.push_back(info.channels.size());
}

/// `row` runs one statement within the transaction; an error takes all of the transaction along.
template <class Row>
void RecordFile::write(Row row) {
  try {
    begin();
    row();
  } catch (const std::exception&) {
    abandon();
    throw;
  }
}

// seq is the row's number in memory plus one, as SQLite counts its rows; verification compares the
// largest seq with the count.
void RecordFile::sample(std::size_t stream, std::size_t row, Time time,
                        std::span<const double> values) {
  Statement& insert = inserts_.at(stream);
  // A short row would keep what the row before had in the columns that are left.
  if (values.size() != widths_[stream])
    throw std::invalid_argument("sample: stream " + std::to_string(stream) + " has " +
                                std::to_string(widths_[stream]) + " channels, not " +
                                std::to_string(values.size()));
  write([&] {
    insert.bind(1, whole(row) + 1).bind(2, std::int64_t{time.count()});
    // After seq and t_ns.
    int index = 3;
    for (double value : values) insert.bind(index++, value);
    insert.run();
  });
  bytes_ += 8 + 9 * values.size();  // about: SQLite keeps a byte of type beside each number
  row_written();
}

void RecordFile::event(std::size_t number, const Event& event) {
  const bool grave = is_grave(event.kind);
  if (grave) {
    commit();  // the pragma does not work within a transaction
    database_.execute("PRAGMA synchronous=FULL");
  }
  write([&] {
    database_.prepare("INSERT OR IGNORE INTO event VALUES(?,?,?,?)")
        .bind(1, whole(number) + 1)
        .bind(2, std::int64_t{event.time.count()})
        .bind(3, event.kind)
        .bind(4, event.text)
        .run();
  });
  commit();
  if (grave) database_.execute("PRAGMA synchronous=NORMAL");
}

// The one table where a second row of the same key changes the first: a script may state a result
// again.
void RecordFile::result(const StatedResult& result) {
  write([&] {
    database_
        .prepare(
            "INSERT INTO result VALUES(?,?,?) ON CONFLICT(name) DO UPDATE SET "
            "value=excluded.value, unit=excluded.unit")
        .bind(1, result.name)
        .bind(2, result.value)
        .bind(3, result.unit)
        .run();
  });
  row_written();
}

void RecordFile::plot(std::size_t number, const Plot& plot) {
  write([&] {
    const std::string text = dumped(plot_json(plot));
    bytes_ += text.size();
    database_.prepare("INSERT OR IGNORE INTO plot VALUES(?,?,?)")
        .bind(1, whole(number) + 1)
        .bind(2, plot.title)
        .bind(3, text)
        .run();
  });
  row_written();
}

void RecordFile::drawing(std::size_t number, const SvgDrawing& drawing) {
  write([&] {
    database_.prepare("INSERT OR IGNORE INTO drawing VALUES(?,?,?)")
        .bind(1, whole(number) + 1)
        .bind(2, drawing.title)
        .bind(3, drawing.svg)
        .run();
  });
  row_written();
}

void RecordFile::table(std::size_t number, const Table& table) {
  write([&] {
    database_.prepare("INSERT OR IGNORE INTO result_table VALUES(?,?,?,?)")
        .bind(1, whole(number) + 1)
        .bind(2, table.title)
        .bind(3, dumped(table.header))
        .bind(4, dumped(table.rows))
        .run();
  });
  row_written();
}

void RecordFile::picture(std::size_t number, const Picture& picture) {
  write([&] {
    database_.prepare("INSERT OR IGNORE INTO picture VALUES(?,?,?,?)")
        .bind(1, whole(number) + 1)
        .bind(2, picture.name)
        .bind(3, picture.caption)
        .bind(4, picture.file)
        .run();
  });
  row_written();
}

void RecordFile::labels(const nlohmann::json& tags, const nlohmann::json& sample) {
  write([&] {
    database_.prepare("UPDATE run SET tags=?, sample=?")
        .bind(1, dumped(tags))
        .bind(2, dumped(sample))
        .run();
  });
  commit();
}

void RecordFile::module(const Module& module) {
  write([&] {
    database_.prepare("INSERT OR IGNORE INTO module VALUES(?,?,?,?)")
        .bind(1, module.name)
        .bind(2, module.file)
        .bind(3, sha256(module.text))
        .bind(4, module.text)
        .run();
  });
  row_written();
}

// The table comes with the first row: most runs trace nothing. It may be there already, from a
// transaction before one that failed.
void RecordFile::link(std::size_t number, const LinkRow& row) {
  if (!link_insert_) {
    begin();
    database_.execute(create_table("link"));
    commit();
    link_insert_ = database_.prepare("INSERT OR IGNORE INTO link VALUES(?,?,?,?,?,?)");
  }
  write([&] {
    link_insert_->bind(1, whole(number) + 1)
        .bind(2, std::int64_t{row.time.count()})
        .bind(3, row.role)
        .bind(4, row.address)
        .bind(5, row.event)
        .bind(6, std::span(row.bytes))
        .run();
  });
  bytes_ += 32 + row.bytes.size();  // about
  row_written();
}

void RecordFile::camera(const RecordedCameraInfo& info) {
  write([&] {
    database_.prepare("INSERT OR IGNORE INTO camera VALUES(?,?,?,?,?,?,?,?)")
        .bind(1, info.camera)
        .bind(2, info.identity)
        .bind(3, std::int64_t{info.every})
        .bind(4, info.frame_period)
        .bind(5, info.effective_pixel)
        .bind(6, std::int64_t{info.bits})
        .bind(7, std::int64_t{info.offset_x_px})
        .bind(8, std::int64_t{info.offset_y_px})
        .run();
  });
  commit();
}

void RecordFile::frame(std::size_t number, const FrameRow& row) {
  write([&] {
    Statement insert =
        database_.prepare("INSERT OR IGNORE INTO frame VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)");
    insert.bind(1, whole(number) + 1)
        .bind(2, row.camera)
        .bind(3, static_cast<std::int64_t>(row.number));
    insert.bind(4, std::int64_t{row.exposed.count()}).bind(5, std::int64_t{row.received.count()});
    if (row.device) insert.bind(6, std::int64_t{row.device->count()});
    insert.bind(7, row.file).bind(8, whole(row.offset)).bind(9, whole(row.bytes));
    insert.bind(10, std::int64_t{row.width_px}).bind(11, std::int64_t{row.height_px});
    insert.bind(12, std::int64_t{row.pixel_type}).bind(13, std::int64_t{row.crc32});
    insert.bind(14, whole(row.dropped_before)).bind(15, whole(row.lost_before)).run();
  });
  row_written();
}

// Each step on its own, the first error last: a full disk may refuse the rows and still have room
// for the end record, without which the run would count as lost.
void RecordFile::end(const RunEnd& end, const RunData& data, const std::vector<FrameRow>& frames,
                     bool all_there) {
  std::exception_ptr failure;
  const auto guarded = [&](auto action) {
    try {
      action();
      return true;
    } catch (const std::exception&) {
      if (!failure) failure = std::current_exception();
      abandon();
      return false;
    }
  };
  guarded([&] { commit(); });
  if (!all_there || lost_rows_) {
    // What the WAL holds moves into the file proper, and its room is free for what follows.
    guarded([&] { database_.execute("PRAGMA wal_checkpoint(TRUNCATE)"); });
    failure = nullptr;  // all is tried again
    guarded([&] { write_again(data, frames); });
  }
  write_end(end, data);
  if (failure) std::rethrow_exception(failure);
}

/// Everything once more, from memory. Rows that are there stay (INSERT OR IGNORE by their number).
void RecordFile::write_again(const RunData& data, const std::vector<FrameRow>& frames) {
  lost_rows_ = false;
  // Streams whose CREATE TABLE was in the transaction that failed: their number is the next one
  // here too.
  for (std::size_t i = inserts_.size(); i < data.streams.size(); ++i)
    add_stream(data.streams[i].info);
  for (std::size_t i = 0; i < data.streams.size(); ++i) {
    const Stream& stream = data.streams[i];
    const std::size_t width = stream.info.channels.size();
    for (std::size_t row = 0; row < stream.times.size(); ++row)
      sample(i, row, stream.times[row], {stream.values.data() + row * width, width});
  }
  const auto each = [](const auto& list, auto one) {
    for (std::size_t i = 0; i < list.size(); ++i) one(i, list[i]);
  };
  each(data.events, [&](std::size_t i, const Event& one) { event(i, one); });
  each(data.results, [&](std::size_t, const StatedResult& one) { result(one); });
  each(data.plots, [&](std::size_t i, const Plot& one) { plot(i, one); });
  each(data.drawings, [&](std::size_t i, const SvgDrawing& one) { drawing(i, one); });
  each(data.tables, [&](std::size_t i, const Table& one) { table(i, one); });
  each(data.pictures, [&](std::size_t i, const Picture& one) { picture(i, one); });
  labels(data.start.tags, data.start.sample);
  each(data.modules, [&](std::size_t, const Module& one) { module(one); });
  each(data.links, [&](std::size_t i, const LinkRow& one) { link(i, one); });
  each(data.cameras, [&](std::size_t, const RecordedCameraInfo& one) { camera(one); });
  each(frames, [&](std::size_t i, const FrameRow& one) { frame(i, one); });
  commit();
}

/// Counts of what must be in the file: `vitreo verify` compares.
void RecordFile::write_end(const RunEnd& end, const RunData& data) {
  nlohmann::json counts = nlohmann::json::object();
  nlohmann::json dropped = nlohmann::json::object();
  for (const Stream& stream : data.streams) counts[stream.info.name] = stream.times.size();
  for (std::size_t i = 0; i < data.cameras.size() && i < data.dropped.size(); ++i)
    dropped[data.cameras[i].camera] = data.dropped[i];
  nlohmann::json lost = nlohmann::json::object();
  for (std::size_t i = 0; i < data.cameras.size() && i < data.lost.size(); ++i)
    lost[data.cameras[i].camera] = data.lost[i];
  // Before begin(), within which the pragma does nothing; this commit waits for the disk.
  database_.execute("PRAGMA synchronous=FULL");
  begin();
  database_.prepare("INSERT INTO stop VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?)")
      .bind(1, wall_time_text())
      .bind(2, std::string_view(to_string(end.outcome)))
      .bind(3, end.reason)
      .bind(4, end.location.empty() ? script_line(end.reason) : end.location)
      .bind(5, end.experiment_time)
      .bind(6, end.wall_time)
      .bind(7, dumped(counts))
      .bind(8, dumped(dropped))
      .bind(9, data.held)
      .bind(10, dumped(lost))
      .bind(11, end.cause.by)
      .bind(12, end.cause.name)
      .bind(13, end.cause.face)
      .bind(14, end.cause.signal)
      .run();
  commit();
}

/// Back to a rollback journal, so that the closed record is one file.
void RecordFile::close() {
  commit();
  // Before the change of journal mode: a statement that is open holds the database.
  inserts_.clear();
  link_insert_.reset();
  try {
    // A reader on a busy machine is at its rows for a while; one that stays is not waited for.
    database_.execute("PRAGMA busy_timeout=2000");
    database_.execute("PRAGMA wal_checkpoint(TRUNCATE)");
    database_.execute("PRAGMA journal_mode=DELETE");
  } catch (const std::exception&) {
    // Another program reads it right now: it stays in WAL mode, as whole as before.
  }
  database_.close();
}

/// IMMEDIATE takes the write lock at once: a later row cannot fail for it.
void RecordFile::begin() {
  if (in_transaction_) return;
  database_.execute("BEGIN IMMEDIATE");
  in_transaction_ = true;
  pending_ = 0;
  begun_ = std::chrono::steady_clock::now();
}

// Also under the virtual clock, where 1000 rows may come within a millisecond.
void RecordFile::row_written() {
  if (++pending_ >= kCommitRows) commit();
}

void RecordFile::commit_if_due() {
  const auto now = std::chrono::steady_clock::now();
  if (in_transaction_ && now - begun_ >= kCommitAfter) commit();
  if (unsynced_ && now - unsynced_since_ >= kSyncAfter) sync();
}

/// A commit leaves its rows to the system, which may take half a minute to write them. No lock of
/// SQLite's is on this file, so that closing it again takes none away.
void RecordFile::sync() {
  int descriptor = open_existing_file(wal_);
  try {
    sync_file(descriptor, wal_);
  } catch (const std::exception&) {
    close_file(descriptor);
    throw;
  }
  close_file(descriptor);
  unsynced_ = false;
}

void RecordFile::commit() {
  if (!in_transaction_) return;
  try {
    database_.execute("COMMIT");
  } catch (const std::exception&) {
    abandon();
    throw;
  }
  in_transaction_ = false;
  if (!std::exchange(unsynced_, true)) unsynced_since_ = std::chrono::steady_clock::now();
}

/// After an error of the disk: SQLite may or may not have rolled back by itself, and what was
/// pending is to be written again.
void RecordFile::abandon() {
  try {
    database_.execute("ROLLBACK");
  } catch (const std::exception&) {  // it had
  }
  in_transaction_ = false;
  lost_rows_ = true;
}

}  // namespace vitreo
