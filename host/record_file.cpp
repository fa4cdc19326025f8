// SPDX-License-Identifier: Apache-2.0
#include "host/record_file.h"

#include "host/run_folder.h"
#include "host/sha256.h"

#include <exception>

namespace vitreo {
namespace {

constexpr auto kCommitAfter = std::chrono::milliseconds(100);
constexpr int kCommitRows = 1000;

std::string text_of(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string rig_hash(const nlohmann::json& rig) { return sha256(text_of(rig)); }

}  // namespace

RecordFile::RecordFile(const std::filesystem::path& file, const RunStart& start)
    : database_(file.string(), Database::Mode::create) {
  database_.execute("PRAGMA journal_mode=WAL");
  database_.execute("PRAGMA synchronous=FULL");
  begin();
  create_tables();
  write_start(start);
  commit();
  database_.execute("PRAGMA synchronous=NORMAL");
}

void RecordFile::create_tables() {
  database_.execute(R"(
    CREATE TABLE run(uid TEXT, time TEXT, protocol TEXT, title TEXT, script TEXT, script_hash TEXT, operator TEXT,
                     parameters TEXT, parameter_units TEXT, seed TEXT, versions TEXT, rig TEXT, rig_hash TEXT);
    CREATE TABLE stream(id INTEGER PRIMARY KEY, name TEXT UNIQUE, source TEXT, sample_table TEXT);
    CREATE TABLE channel(stream INTEGER REFERENCES stream(id), position INTEGER, name TEXT, unit TEXT);
    CREATE TABLE event(seq INTEGER PRIMARY KEY, t_ns INTEGER, kind TEXT, text TEXT);
    CREATE TABLE figure(name TEXT PRIMARY KEY, value REAL, unit TEXT);
    CREATE TABLE picture(seq INTEGER PRIMARY KEY, name TEXT, caption TEXT, file TEXT);
    CREATE TABLE result_table(seq INTEGER PRIMARY KEY, title TEXT, header TEXT, rows TEXT);
    CREATE TABLE stop(time TEXT, exit_status TEXT, reason TEXT, experiment_time REAL, wall_time REAL, counts TEXT);
  )");
}

void RecordFile::write_start(const RunStart& start) {
  database_.prepare("INSERT INTO run VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?)")
      .bind(1, random_hex(32))
      .bind(2, wall_time_text())
      .bind(3, start.protocol_file)
      .bind(4, start.protocol_title)
      .bind(5, start.protocol_text)
      .bind(6, sha256(start.protocol_text))
      .bind(7, start.operator_name)
      .bind(8, text_of(start.parameters))
      .bind(9, text_of(start.parameter_units))
      .bind(10, std::to_string(start.seed))  // text: SQLite's integers end at 2^63
      .bind(11, text_of(start.versions))
      .bind(12, text_of(start.rig))
      .bind(13, rig_hash(start.rig))
      .run();
}

void RecordFile::add_stream(const StreamInfo& info) {
  const std::string table = quoted_identifier("sample_" + info.name);
  std::string columns = "seq INTEGER PRIMARY KEY, t_ns INTEGER NOT NULL", places = "?,?";
  for (const Channel& channel : info.channels) {
    columns += ", " + quoted_identifier(channel.name) + " REAL";
    places += ",?";
  }
  begin();
  database_.execute("CREATE TABLE " + table + "(" + columns + ")");
  const auto id = static_cast<std::int64_t>(inserts_.size());
  database_.prepare("INSERT INTO stream VALUES(?,?,?,?)")
      .bind(1, id)
      .bind(2, info.name)
      .bind(3, info.source)
      .bind(4, "sample_" + info.name)
      .run();
  Statement insert = database_.prepare("INSERT INTO channel VALUES(?,?,?,?)");
  for (std::size_t i = 0; i < info.channels.size(); ++i) {
    insert.bind(1, id).bind(2, static_cast<std::int64_t>(i)).bind(3, info.channels[i].name);
    insert.bind(4, info.channels[i].unit).run();
  }
  commit();
  // A row that is there already is the same row: see write_again().
  inserts_.push_back(database_.prepare("INSERT OR IGNORE INTO " + table + " VALUES(" + places + ")"));
}

void RecordFile::sample(std::size_t stream, std::size_t row, Time time, std::span<const double> values) {
  Statement& insert = inserts_.at(stream);
  begin();
  insert.bind(1, static_cast<std::int64_t>(row) + 1).bind(2, std::int64_t{time.count()});
  int index = 3;
  for (double value : values) insert.bind(index++, value);
  try {
    insert.run();
  } catch (const std::exception&) {
    abandon();
    throw;
  }
  row_written();
}

void RecordFile::event(const Event& event) {
  begin();
  database_.prepare("INSERT INTO event(t_ns, kind, text) VALUES(?,?,?)")
      .bind(1, std::int64_t{event.time.count()})
      .bind(2, event.kind)
      .bind(3, event.text)
      .run();
  commit();
}

void RecordFile::figure(const Figure& figure) {
  begin();
  database_
      .prepare(
          "INSERT INTO figure VALUES(?,?,?) ON CONFLICT(name) DO UPDATE SET value=excluded.value, unit=excluded.unit")
      .bind(1, figure.name)
      .bind(2, figure.value)
      .bind(3, figure.unit)
      .run();
  row_written();
}

void RecordFile::table(const Table& table) {
  begin();
  database_.prepare("INSERT INTO result_table(title, header, rows) VALUES(?,?,?)")
      .bind(1, table.title)
      .bind(2, text_of(table.header))
      .bind(3, text_of(table.rows))
      .run();
  row_written();
}

void RecordFile::picture(const Picture& picture, const std::string& file) {
  begin();
  database_.prepare("INSERT INTO picture(name, caption, file) VALUES(?,?,?)")
      .bind(1, picture.name)
      .bind(2, picture.caption)
      .bind(3, file)
      .run();
  row_written();
}

void RecordFile::end(const RunEnd& end, const std::vector<Stream>& streams) {
  std::exception_ptr trouble;
  try {
    if (lost_rows_) write_again(streams);
    commit();
  } catch (const std::exception&) {
    trouble = std::current_exception();
    abandon();
  }
  write_end(end, streams);
  if (trouble) std::rethrow_exception(trouble);
}

void RecordFile::write_again(const std::vector<Stream>& streams) {
  for (std::size_t i = 0; i < inserts_.size() && i < streams.size(); ++i) {
    const std::size_t width = streams[i].info.channels.size();
    for (std::size_t row = 0; row < streams[i].times.size(); ++row) {
      sample(i, row, streams[i].times[row], {streams[i].values.data() + row * width, width});
    }
  }
  lost_rows_ = false;
}

void RecordFile::write_end(const RunEnd& end, const std::vector<Stream>& streams) {
  nlohmann::json counts = nlohmann::json::object();
  for (const Stream& stream : streams) counts[stream.info.name] = stream.times.size();
  database_.execute("PRAGMA synchronous=FULL");
  begin();
  database_.prepare("INSERT INTO stop VALUES(?,?,?,?,?,?)")
      .bind(1, wall_time_text())
      .bind(2, std::string_view(to_string(end.outcome)))
      .bind(3, end.reason)
      .bind(4, end.experiment_time)
      .bind(5, end.wall_time)
      .bind(6, text_of(counts))
      .run();
  commit();
}

void RecordFile::close() {
  commit();
  inserts_.clear();
  try {
    database_.execute("PRAGMA wal_checkpoint(TRUNCATE)");
    database_.execute("PRAGMA journal_mode=DELETE");
  } catch (const std::exception&) {
    // Somebody reads it right now: it stays in WAL mode, as whole as before.
  }
  database_.close();
}

void RecordFile::begin() {
  if (in_transaction_) return;
  database_.execute("BEGIN IMMEDIATE");
  in_transaction_ = true;
  pending_ = 0;
  begun_ = std::chrono::steady_clock::now();
}

void RecordFile::row_written() {
  if (++pending_ >= kCommitRows || std::chrono::steady_clock::now() - begun_ >= kCommitAfter) commit();
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
}

/// After an error of the disk: SQLite may or may not have rolled back by itself, and what was pending is to be written
/// again.
void RecordFile::abandon() {
  try {
    database_.execute("ROLLBACK");
  } catch (const std::exception&) {  // it had
  }
  in_transaction_ = false;
  lost_rows_ = true;
}

}  // namespace vitreo
