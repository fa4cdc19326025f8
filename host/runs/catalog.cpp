// SPDX-License-Identifier: Apache-2.0
#include "host/runs/catalog.h"

#include "host/config/config.h"
#include "host/files/digest.h"
#include "host/record/record_json.h"
#include "host/record/run_labels.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <dirent.h>
#include <fcntl.h>
#include <memory>
#include <numeric>
#include <sys/stat.h>
#include <unordered_map>
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

/// A run that was found, by its id in the views.
struct Catalog::Found {
  std::int64_t id = 0;
  std::string name;
  CatalogRow row;
};

/// What rows are sorted by.
struct Catalog::SortKey {
  QueryName name;
  bool falling = false;  // the largest first
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

/// Inode, size and time of modification (ns) of a folder's run.sqlite, as it is now; empty where
/// there is none. `folder` is of the open directory `parent`, so that its path is walked once and
/// not ten thousand times.
std::string mark_of(int parent, const std::string& folder) {
  struct stat status = {};
  if (fstatat(parent, (folder + "/run.sqlite").c_str(), &status, 0) != 0 ||
      !S_ISREG(status.st_mode))
    return "";
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

/// A folder that is read.
struct CloseFolder {
  void operator()(DIR* folder) const { closedir(folder); }
};
using OpenFolder = std::unique_ptr<DIR, CloseFolder>;

/// Nothing where there is no such folder. Throws RecordError.
OpenFolder open_folder(const fs::path& parent) {
  OpenFolder folder(opendir(parent.c_str()));
  if (!folder && errno != ENOENT)
    throw RecordError(parent.string() + ": cannot be listed: " + std::strerror(errno));
  return folder;
}

/// Names of what may be a folder, sorted. Throws RecordError.
std::vector<std::string> names_in(DIR* folder, const fs::path& parent) {
  std::vector<std::string> names;
  errno = 0;
  while (const dirent* const entry = readdir(folder)) {
    // Some file systems do not say what an entry is; a link may lead to a folder.
    const bool other =
        entry->d_type != DT_DIR && entry->d_type != DT_LNK && entry->d_type != DT_UNKNOWN;
    const std::string_view name = entry->d_name;
    if (!other && name != "." && name != "..") names.emplace_back(name);
  }
  if (errno != 0)
    throw RecordError(parent.string() + ": cannot be listed: " + std::strerror(errno));
  std::sort(names.begin(), names.end());
  return names;
}

SqlCondition both(SqlCondition a, const SqlCondition& b) {
  a.sql += " AND (" + b.sql + ")";
  a.values.insert(a.values.end(), b.values.begin(), b.values.end());
  return a;
}

using Cell = std::optional<CatalogValue>;

/// Numbers before texts, and what is not known behind all, whichever way it is sorted.
int rank_of(const Cell& cell) {
  if (cell && cell->number) return 0;
  return cell && !cell->text.empty() ? 1 : 2;
}

/// Whether `a` stands before `b`.
bool before(const Cell& a, const Cell& b, bool falling) {
  const int rank = rank_of(a);
  if (rank != rank_of(b)) return rank < rank_of(b);
  if (rank == 2) return false;
  const Cell& low = falling ? b : a;
  const Cell& high = falling ? a : b;
  return rank == 0 ? *low->number < *high->number : low->text < high->text;
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

// What is not kept lies in tables of this connection alone, and the views have both. A run that is
// there is not taken from the index as well: another program may have added it meanwhile.
void Catalog::prepare() {
  database_->execute(R"(
CREATE TEMP TABLE hidden(id INTEGER PRIMARY KEY);
CREATE TEMP TABLE run_now AS SELECT * FROM main.run WHERE 0;
CREATE TEMP TABLE value_now AS SELECT * FROM main.value WHERE 0;
CREATE TEMP VIEW all_run AS
  SELECT * FROM main.run WHERE id NOT IN (SELECT id FROM temp.hidden)
    AND name NOT IN (SELECT name FROM temp.run_now)
  UNION ALL SELECT * FROM temp.run_now;
CREATE TEMP VIEW all_value AS
  SELECT * FROM main.value UNION ALL SELECT * FROM temp.value_now;
)");
}

// What the index knows and the folders do not is forgotten; what they know better is read. Both are
// in the order of their names, and are walked side by side.
void Catalog::update() {
  const OpenFolder open = open_folder(parent_);
  const std::vector<std::string> names =
      open ? names_in(open.get(), parent_) : std::vector<std::string>();
  const int place = open ? dirfd(open.get()) : -1;
  // By its index alone, which has all three; at once, since who reads locks out who writes.
  struct Known {
    std::string name;
    std::int64_t id;
    std::string mark;
  };
  std::vector<Known> known;
  Statement rows =
      database_->prepare("SELECT name, id, mark FROM main.run INDEXED BY run_mark ORDER BY name");
  while (rows.step()) known.push_back({rows.text(0), rows.integer(1), rows.text(2)});
  Changes changes;
  auto next = known.begin();
  for (const std::string& name : names) {
    const std::string mark = mark_of(place, name);
    if (mark.empty()) continue;
    for (; next != known.end() && next->name < name; ++next) changes.outdated.push_back(next->id);
    if (next != known.end() && next->name == name) {
      const bool same = next->mark == mark;
      if (!same) changes.outdated.push_back(next->id);
      ++next;
      if (same) continue;
    }
    RunSummary run = read_summary(parent_ / name);
    ++read_;
    // Not kept: what changed while it was read.
    const bool lasting = run.lasting && mark_of(place, name) == mark;
    (lasting ? changes.lasting : changes.passing).push_back({name, mark, std::move(run)});
  }
  for (; next != known.end(); ++next) changes.outdated.push_back(next->id);
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

// From one unit to the next by the index, not through the values of ten thousand runs. A result is
// always a number: without one it was not finite.
std::vector<KnownValue> Catalog::known_values(const std::string& name, char kind) {
  Statement next = database_->prepare(
      "SELECT unit FROM all_value WHERE kind = ?1 AND name = ?2 AND unit > ?3 "
      "ORDER BY unit LIMIT 1");
  // With a value of this unit: a number, and none.
  Statement first = database_->prepare(
      "SELECT unit FROM all_value WHERE kind = ?1 AND name = ?2 AND unit = '' LIMIT 1");
  Statement has = database_->prepare(
      "SELECT EXISTS(SELECT 1 FROM all_value WHERE kind = ?1 AND name = ?2 AND unit = ?3 "
      "AND number IS NOT NULL), EXISTS(SELECT 1 FROM all_value WHERE kind = ?1 AND name = ?2 "
      "AND unit = ?3 AND number IS NULL)");
  std::vector<KnownValue> found;
  const auto add = [&](char letter, const std::string& unit) {
    has.bind(1, std::string_view(&letter, 1)).bind(2, name).bind(3, unit);
    has.step();
    const bool empty = has.integer(1) != 0;
    if (has.integer(0) != 0 || (empty && letter == 'r')) found.push_back({letter, unit, false});
    if (empty && letter != 'r') found.push_back({letter, unit, true});
    has.step();
  };
  const std::string letters = kind == 0 ? kCatalogKinds : std::string(1, kind);
  for (const char& letter : letters) {
    const std::string_view one(&letter, 1);
    first.bind(1, one).bind(2, name);
    if (first.step()) {
      add(letter, "");
      first.step();
    }
    std::string unit;
    while (next.bind(1, one).bind(2, name).bind(3, unit).step()) {
      unit = next.text(0);
      next.step();
      add(letter, unit);
    }
  }
  return found;
}

/// The list of all names is made for an error alone.
Vocabulary Catalog::vocabulary() {
  return {[this](const std::string& name, char kind) { return known_values(name, kind); },
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
  std::vector<SortKey> keys;
  for (const std::string& word : request.sort) {
    const bool falling = word.starts_with('-');
    keys.push_back({query_name(falling ? word.substr(1) : word, known, "--sort: "), falling});
  }
  // The SQL has fixed words and the columns of the layout alone: every text of the request is
  // bound.
  Statement rows = database_->prepare(
      "SELECT id, name, time, protocol, title, operator, seed, outcome, reason, experiment_time, "
      "rig, ended_by FROM all_run WHERE " +
      where.sql);
  int index = 0;
  for (const auto& value : where.values)
    std::visit([&](const auto& one) { rows.bind(++index, one); }, value);
  std::vector<Found> found;
  while (rows.step()) found.push_back({rows.integer(0), rows.text(1), {head_of(rows), {}}});
  // Here and not in SQL, which would carry whole rows about.
  std::sort(found.begin(), found.end(),
            [](const Found& a, const Found& b) { return a.name < b.name; });
  // The names begin with the time: the newest are the last of them, however the rest is sorted.
  if (request.newest > 0 && found.size() > request.newest)
    found.erase(found.begin(), found.end() - static_cast<std::ptrdiff_t>(request.newest));
  for (const QueryName& column : columns) {
    std::vector<Cell> cells = cells_of(column, found);
    for (std::size_t i = 0; i < found.size(); ++i)
      found[i].row.columns.push_back(std::move(cells[i]));
  }
  return sorted(std::move(found), keys);
}

std::vector<CatalogRow> Catalog::sorted(std::vector<Found> found,
                                        const std::vector<SortKey>& keys) {
  std::vector<std::vector<Cell>> cells;
  for (const SortKey& key : keys) cells.push_back(cells_of(key.name, found));
  std::vector<std::size_t> order(found.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    for (std::size_t k = 0; k < keys.size(); ++k) {
      if (before(cells[k][a], cells[k][b], keys[k].falling)) return true;
      if (before(cells[k][b], cells[k][a], keys[k].falling)) return false;
    }
    return false;
  });
  std::vector<CatalogRow> rows;
  rows.reserve(found.size());
  for (const std::size_t i : order) rows.push_back(std::move(found[i].row));
  return rows;
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

/// One walk over all values of a name: a look-up a run takes five times as long for ten thousand.
std::vector<Cell> Catalog::cells_of(const QueryName& column, const std::vector<Found>& found) {
  const bool number = column.field == "version";
  Statement values = database_->prepare(
      column.field.empty()
          ? "SELECT run, number, text, unit FROM all_value WHERE " + kind_condition(column.kind) +
                " AND name = ?"
          : fmt::format("SELECT id, {}, {}, '' FROM all_run", number ? column.field : "NULL",
                        number ? "NULL" : column.field));
  if (column.field.empty()) values.bind(1, column.name);
  std::unordered_map<std::int64_t, CatalogValue> by_run;
  by_run.reserve(found.size());
  while (values.step()) {
    // Where a parameter and a result share the name the first one counts.
    const auto [place, added] = by_run.try_emplace(values.integer(0));
    if (!added) continue;
    if (!values.is_null(1)) place->second.number = values.real(1);
    place->second.text = values.text(2);
    place->second.unit = values.text(3);
  }
  std::vector<Cell> cells(found.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    const auto value = by_run.find(found[i].id);
    if (value != by_run.end()) cells[i] = std::move(value->second);
  }
  return cells;
}

}  // namespace vitreo
