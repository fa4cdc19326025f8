// SPDX-License-Identifier: Apache-2.0
#include "host/runs/catalog.h"

#include "host/config/config.h"
#include "host/files/digest.h"
#include "host/record/record_json.h"
#include "host/record/run_labels.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <initializer_list>
#include <map>
#include <set>
#include <sys/stat.h>
#include <utility>

namespace vitreo {

namespace fs = std::filesystem;

/// A run as it was read from its folder.
struct Catalog::Fresh {
  std::string name;
  std::string mark;
  RunSummary run;
};

/// What one look at the folders has found, before any of it is written. `outdated`: ids of rows
/// whose run has changed or is gone.
struct Catalog::Changes {
  std::vector<Fresh> lasting;  // to be kept in the index
  std::vector<Fresh> passing;  // runs that go on, or cannot be read
  std::vector<std::int64_t> outdated;
};

namespace {

// The rows of closed runs; python/vitreo/catalog.py makes the same tables.
// A value has its number in SI, or a text, or both where it is a flag. `run_mark` has all that
// update() asks for, and `value_name` all of a comparison with a number, so that neither reads the
// tables.
constexpr const char* kLayout = R"(
CREATE TABLE run(id INTEGER PRIMARY KEY, name TEXT UNIQUE, mark TEXT, time TEXT, t0_utc_ns INTEGER,
  protocol TEXT, title TEXT, operator TEXT, seed TEXT, outcome TEXT, reason TEXT, ended_by TEXT,
  experiment_time REAL, wall_time REAL, version INTEGER, rig TEXT, words TEXT);
CREATE TABLE value(run INTEGER, kind TEXT, name TEXT, number REAL, text TEXT, unit TEXT);
CREATE INDEX run_mark ON run(name, mark);
CREATE INDEX value_name ON value(name, kind, unit, number, run);
CREATE INDEX value_run ON value(run, name);
)";
// In the order in which Writer binds them.
constexpr const char* kRunColumns =
    "id, name, mark, time, t0_utc_ns, protocol, title, operator, seed, outcome, reason, ended_by, "
    "experiment_time, wall_time, version, rig, words";

// Runs that are not to be kept: they go on, or the index could not be written. Beyond every id of
// the index.
constexpr std::int64_t kFirstTemporary = std::int64_t{1} << 40;

/// Inode, size and time of modification (ns) of run.sqlite, as it is now; empty where there is
/// none.
std::string mark_of(const fs::path& folder) {
  struct stat status = {};
  if (stat((folder / "run.sqlite").c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return "";
  const std::int64_t changed =
      std::int64_t{status.st_mtim.tv_sec} * 1'000'000'000 + status.st_mtim.tv_nsec;
  return fmt::format("{} {} {}", status.st_ino, status.st_size, changed);
}

/// Two folders have two names of an index; python/vitreo/catalog.py makes the same.
std::string digest_of(const fs::path& folder) { return sha256(folder.string()).substr(0, 24); }

/// Where rows go: the tables of the index, or those of this connection.
struct Place {
  const char* runs;
  const char* values;
};
constexpr Place kIndex{"main.run", "main.value"};
constexpr Place kNow{"temp.run_now", "temp.value_now"};

/// Writes runs with their values. It begins no transaction: the caller decides what is atomic.
class Writer {
 public:
  Writer(Database& database, const Place& place)
      : run_(database.prepare(std::string("INSERT INTO ") + place.runs + "(" + kRunColumns +
                              ") VALUES(?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)")),
        value_(database.prepare(std::string("INSERT INTO ") + place.values +
                                " VALUES(?,?,?,?,?,?)")) {}

  void write(std::int64_t id, const std::string& name, const std::string& mark,
             const RunSummary& run) {
    const RunHead& head = run.head;
    run_.bind(1, id).bind(2, name).bind(3, mark).bind(4, head.time);
    run.t0_utc_ns ? run_.bind(5, *run.t0_utc_ns) : run_.bind_null(5);
    run_.bind(6, head.protocol).bind(7, head.title).bind(8, head.operator_name);
    run_.bind(9, head.seed).bind(10, head.state).bind(11, head.reason).bind(12, head.ended_by);
    run_.bind(13, head.experiment_time).bind(14, run.wall_time);
    run_.bind(15, std::int64_t{run.version}).bind(16, head.rig).bind(17, run.words).run();
    for (const NamedValue& one : run.values) {
      value_.bind(1, id).bind(2, std::string_view(&one.kind, 1)).bind(3, one.name);
      one.number ? value_.bind(4, *one.number) : value_.bind_null(4);
      one.number&& one.text.empty() ? value_.bind_null(5) : value_.bind(5, one.text);
      value_.bind(6, one.unit).run();
    }
  }

 private:
  Statement run_;
  Statement value_;
};

std::int64_t whole_of(Database& database, const std::string& query) {
  Statement row = database.prepare(query);
  return row.step() ? row.integer(0) : 0;
}

/// The folders below; none where there is no such folder. Throws RecordError.
std::vector<fs::path> folders_below(const fs::path& parent) {
  std::vector<fs::path> folders;
  std::error_code error;
  if (!fs::exists(parent, error)) return folders;
  for (fs::directory_iterator entry(parent, error); !error && entry != fs::directory_iterator();
       entry.increment(error))
    folders.push_back(entry->path());
  if (error) throw RecordError(parent.string() + ": cannot be listed: " + error.message());
  return folders;
}

/// A run's value under a name, for an ORDER BY.
std::string value_sql(const QueryName& name, const std::string& column) {
  return "(SELECT " + column + " FROM all_value WHERE run = all_run.id AND name = ?" +
         (name.kind == 0 ? "" : fmt::format(" AND kind = '{}'", name.kind)) + " LIMIT 1)";
}

SqlCondition both(SqlCondition a, const SqlCondition& b) {
  a.sql += " AND (" + b.sql + ")";
  a.values.insert(a.values.end(), b.values.begin(), b.values.end());
  return a;
}

/// "speed, -time" as the beginning of an ORDER BY: "-" before a name is the largest first.
SqlCondition order_by(const std::vector<std::string>& keys, const Vocabulary& known) {
  SqlCondition order;
  for (const std::string& key : keys) {
    const bool falling = key.starts_with('-');
    const QueryName name = query_name(falling ? key.substr(1) : key, known, "--sort: ");
    const bool field = !name.field.empty();
    order.sql += (field ? name.field : value_sql(name, "coalesce(number, text)")) +
                 (falling ? " DESC" : "") + " NULLS LAST, ";
    if (!field) order.values.emplace_back(name.name);
  }
  return order;
}

}  // namespace

fs::path Catalog::file_of(const fs::path& parent) {
  const char* const cache = std::getenv("XDG_CACHE_HOME");
  const char* const home = std::getenv("HOME");
  fs::path folder;
  if (cache != nullptr && *cache == '/')
    folder = cache;
  else if (home != nullptr && *home == '/')
    folder = fs::path(home) / ".cache";
  else
    return {};
  std::error_code error;
  // One folder has one index, by whichever path it is named.
  const fs::path whole = fs::weakly_canonical(parent, error);
  return folder / "vitreo" / ("catalog-" + digest_of(error ? parent : whole) + ".sqlite");
}

// Three tries: the index as it is, a new one in its place, one in memory. Each does the whole work,
// as a damage may show only where it is read.
Catalog::Catalog(const fs::path& parent, fs::path index) : parent_(parent) {
  if (index.empty()) index = file_of(parent);
  for (int attempt = 1; attempt <= 3; ++attempt) {
    read_ = 0;
    in_memory_ = index.empty() || attempt == 3;
    try {
      open(in_memory_ ? fs::path() : index);
      update();
      return;
    } catch (const RecordError&) {
      throw;
    } catch (const DatabaseError& error) {
      database_.reset();
      if (in_memory_) throw RecordError(parent_.string() + ": cannot be listed: " + error.what());
      // Locked, or no room: by-passed. Damaged or foreign: made anew.
      if (!error.damaged()) index.clear();
      std::error_code ignored;
      if (error.damaged()) fs::remove(index, ignored);
    }
  }
}

void Catalog::open(const fs::path& index) {
  if (in_memory_) {
    database_.emplace(":memory:", Database::Mode::create);
    database_->execute(kLayout);
    return prepare();
  }
  std::error_code error;
  fs::create_directories(index.parent_path(), error);
  if (error) throw DatabaseError(index.string() + ": " + error.message(), SQLITE_CANTOPEN);
  database_.emplace(index.string(), Database::Mode::create);
  database_->execute("PRAGMA busy_timeout=200");
  // An index is worth no wait for the disk: after a power cut it is made anew.
  database_->execute("PRAGMA synchronous=OFF");
  // KiB, negative: room for the index of ten thousand runs, so that no page is read twice.
  database_->execute("PRAGMA cache_size=-65536");
  const std::int64_t layout = whole_of(*database_, "PRAGMA user_version");
  if (layout == kCatalogLayout) return prepare();
  if (whole_of(*database_, "SELECT count(*) FROM sqlite_master") > 0)
    throw DatabaseError(index.string() + ": is no index of this program", SQLITE_NOTADB);
  database_->execute(std::string("BEGIN IMMEDIATE;") + kLayout +
                     "PRAGMA user_version=" + std::to_string(kCatalogLayout) + ";COMMIT");
  prepare();
}

// What is not kept lies in tables of this connection alone, and the views have both.
void Catalog::prepare() {
  database_->execute(R"(
CREATE TEMP TABLE hidden(id INTEGER PRIMARY KEY);
CREATE TEMP TABLE run_now AS SELECT * FROM main.run WHERE 0;
CREATE TEMP TABLE value_now AS SELECT * FROM main.value WHERE 0;
CREATE TEMP VIEW all_run AS
  SELECT * FROM main.run WHERE id NOT IN (SELECT id FROM temp.hidden)
  UNION ALL SELECT * FROM temp.run_now;
CREATE TEMP VIEW all_value AS
  SELECT * FROM main.value UNION ALL SELECT * FROM temp.value_now;
)");
}

// What the index knows and the folders do not is forgotten; what they know better is read.
void Catalog::update() {
  std::map<std::string, std::pair<std::int64_t, std::string>> known;
  // By its index alone, which has all three.
  Statement rows = database_->prepare("SELECT name, id, mark FROM main.run INDEXED BY run_mark");
  while (rows.step()) known[rows.text(0)] = {rows.integer(1), rows.text(2)};
  Changes changes;
  std::set<std::string> there;
  for (const fs::path& folder : folders_below(parent_)) {
    const std::string name = folder.filename().string();
    const std::string mark = mark_of(folder);
    if (mark.empty()) continue;
    there.insert(name);
    const auto found = known.find(name);
    if (found != known.end() && found->second.second == mark) continue;
    if (found != known.end()) changes.outdated.push_back(found->second.first);
    RunSummary run = read_summary(folder);
    ++read_;
    // Not kept: what changed while it was read.
    const bool lasting = run.lasting && mark_of(folder) == mark;
    (lasting ? changes.lasting : changes.passing).push_back({name, mark, std::move(run)});
  }
  for (const auto& [name, entry] : known)
    if (!there.contains(name)) changes.outdated.push_back(entry.first);
  keep(changes);
  Writer now(*database_, kNow);
  std::int64_t id = kFirstTemporary;
  for (const auto* const list : {&changes.lasting, &changes.passing})
    for (const Fresh& one : *list) now.write(id++, one.name, one.mark, one.run);
}

// What could not be kept stays in `changes.lasting`, and is listed all the same.
void Catalog::keep(Changes& changes) {
  if (changes.lasting.empty() && changes.outdated.empty()) return;
  const auto each_outdated = [&](const char* sql) {
    Statement statement = database_->prepare(sql);
    for (const std::int64_t id : changes.outdated) statement.bind(1, id).run();
  };
  try {
    // The lock for writing is taken at once: a transaction that begins by reading and writes later
    // may be refused in its midst, where SQLite does not wait.
    database_->execute("BEGIN IMMEDIATE");
    each_outdated("DELETE FROM main.value WHERE run=?");
    each_outdated("DELETE FROM main.run WHERE id=?");
    std::int64_t id = whole_of(*database_, "SELECT coalesce(max(id), 0) FROM main.run");
    {
      Writer index(*database_, kIndex);
      // Another program may have added it since: its row is replaced.
      Statement values = database_->prepare(
          "DELETE FROM main.value WHERE run IN (SELECT id FROM main.run WHERE name=?)");
      Statement same = database_->prepare("DELETE FROM main.run WHERE name=?");
      for (const Fresh& one : changes.lasting) {
        values.bind(1, one.name).run();
        same.bind(1, one.name).run();
        index.write(++id, one.name, one.mark, one.run);
      }
    }
    database_->execute("COMMIT");
    changes.lasting.clear();
  } catch (const DatabaseError& problem) {
    if (problem.damaged()) throw;
    try {
      database_->execute("ROLLBACK");
    } catch (const DatabaseError&) {  // SQLite had done it, or nothing was begun
    }
    // What could not be deleted is left out of the views of this connection instead.
    each_outdated("INSERT OR IGNORE INTO temp.hidden VALUES(?)");
  }
}

/// Asked for each name of a query: the index is looked up by that name, and the list of all names
/// is made for an error alone.
Vocabulary Catalog::vocabulary() {
  return {[this](const std::string& name, char kind) {
            std::vector<KnownValue> found;
            Statement rows = database_->prepare(
                "SELECT DISTINCT kind, unit, number IS NULL FROM all_value WHERE name = ?" +
                (kind == 0 ? std::string() : fmt::format(" AND kind = '{}'", kind)));
            rows.bind(1, name);
            while (rows.step())
              found.push_back({rows.text(0).empty() ? 'p' : rows.text(0)[0], rows.text(1),
                               rows.integer(2) != 0});
            return found;
          },
          [this] {
            std::vector<std::string> names;
            Statement rows = database_->prepare("SELECT DISTINCT name FROM all_value");
            while (rows.step()) names.push_back(rows.text(0));
            return names;
          }};
}

std::vector<CatalogRow> Catalog::find(const CatalogRequest& request, const std::string& also) {
  // Without a run no name is known.
  if (whole_of(*database_, "SELECT EXISTS(SELECT 1 FROM all_run)") == 0) return {};
  const Vocabulary known = vocabulary();
  SqlCondition where{"1", {}};
  for (const std::string& text : {also, request.where})
    if (!text.empty()) where = both(std::move(where), translate_query(text, known));
  std::vector<QueryName> columns;
  for (const std::string& word : request.columns)
    columns.push_back(query_name(word, known, "--columns: "));
  // The SQL has fixed words and the columns of the layout alone: every text of the request is
  // bound.
  const SqlCondition order = order_by(request.sort, known);
  Statement rows = database_->prepare(
      "SELECT id, name, time, protocol, title, operator, seed, outcome, reason, experiment_time, "
      "rig, ended_by FROM all_run WHERE " +
      where.sql + " ORDER BY " + order.sql + "name");
  // The parameters of the condition stand before those of the order.
  int index = 0;
  for (const SqlCondition* const part : std::initializer_list<const SqlCondition*>{&where, &order})
    for (const auto& value : part->values)
      std::visit([&](const auto& one) { rows.bind(++index, one); }, value);
  std::vector<CatalogRow> found;
  std::vector<std::int64_t> ids;
  while (rows.step()) {
    ids.push_back(rows.integer(0));
    found.push_back({head_of(rows), {}});
  }
  for (const QueryName& column : columns) fill_column(column, ids, found);
  return found;
}

/// Of a row of find()'s query.
RunHead Catalog::head_of(const Statement& row) const {
  return {(parent_ / row.text(1)).string(),
          row.text(2),
          row.text(3),
          row.text(4),
          row.text(5),
          row.text(6),
          row.text(7),
          row.text(8),
          row.real(9),
          row.text(10),
          row.text(11)};
}

void Catalog::fill_column(const QueryName& column, const std::vector<std::int64_t>& ids,
                          std::vector<CatalogRow>& rows) {
  Statement value = database_->prepare(
      column.field.empty()
          ? "SELECT number, text, unit FROM all_value WHERE run = ? AND name = ?" +
                (column.kind == 0 ? "" : fmt::format(" AND kind = '{}'", column.kind)) + " LIMIT 1"
          : "SELECT NULL, " + column.field + ", '' FROM all_run WHERE id = ?");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    value.bind(1, ids[i]);
    if (column.field.empty()) value.bind(2, column.name);
    std::optional<CatalogValue> one;
    if (value.step()) {
      one.emplace();
      if (!value.is_null(0)) one->number = value.real(0);
      one->text = value.text(1);
      one->unit = value.text(2);
      // To its end, where the statement is ready for the next run.
      value.step();
    }
    rows[i].columns.push_back(std::move(one));
  }
}

}  // namespace vitreo
