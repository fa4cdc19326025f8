// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_table.h"

#include "host/files/posix_file.h"
#include "host/files/published_file.h"
#include "host/files/run_folder.h"
#include "host/files/sqlite.h"
#include "host/record/record_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

/// Stated by every run, and different each time.
bool depends_on_machine(const std::string& result) { return result == "wall_time"; }

/// The columns of a parameter: three of a vector, two of a range.
std::vector<SweepColumn> columns_of(const nlohmann::json& axis) {
  const std::string name = axis.at("name");
  const std::string unit = axis.at("unit");
  const std::string kind = axis.at("kind");
  std::vector<std::string> names{name};
  if (kind == "vector") names = {name + "_x", name + "_y", name + "_z"};
  if (kind == "range") names = {name + "_min", name + "_max"};
  std::vector<SweepColumn> columns;
  for (const std::string& one : names)
    columns.push_back({one, kind == "list" ? "" : unit, ColumnRole::varied});
  return columns;
}

/// Flags are words, as on the command line; null is nothing.
SweepCell cell_of(const nlohmann::json& value) {
  if (value.is_boolean()) return std::string(value.get<bool>() ? "true" : "false");
  if (value.is_number()) return value.get<double>();
  if (value.is_string()) return value.get<std::string>();
  return {};
}

/// "0.0001 0.0005 m/s": a list is a text, since it may have any length.
std::string list_text(const nlohmann::json& values, const std::string& unit) {
  std::string text;
  for (const nlohmann::json& one : values)
    text += (text.empty() ? "" : " ") + fmt::format("{}", one.get<double>());
  return unit.empty() ? text : text + " " + unit;
}

/// The cells of one parameter at one point, as many as columns_of() has columns.
void add_values(const nlohmann::json& axis, const nlohmann::json& value,
                std::vector<SweepCell>& row) {
  if (!value.is_array())
    row.push_back(cell_of(value));
  else if (axis.at("kind") == "list")
    row.emplace_back(list_text(value, axis.at("unit")));
  else
    for (const nlohmann::json& one : value) row.push_back(cell_of(one));
}

/// A run's folder below runs/: in a large sweep there are folders between.
std::string below_runs(const PointFolder& folder, std::size_t point, const std::string& run) {
  const std::string between = folder.runs_of(point).filename().string();
  return run.empty() || between == "runs" ? run : between + "/" + run;
}

/// Places of the results' columns, in the order in which the points name them.
class ResultColumns {
 public:
  explicit ResultColumns(SweepTable& table) : table_(table) {
    for (const SweepColumn& column : table.columns) taken_.insert(lowered(column.name));
  }
  std::size_t of(const std::string& name, const std::string& unit) {
    const auto found = places_.find(name);
    if (found != places_.end()) return found->second;
    std::string free = name;
    // A result may be called as a parameter or a column of every sweep is.
    while (!taken_.insert(lowered(free)).second) free = "result_" + free;
    table_.columns.push_back({free, unit, ColumnRole::result});
    return places_[name] = table_.columns.size() - 1;
  }

 private:
  /// Columns of SQLite are told apart without regard to case.
  static std::string lowered(std::string name) {
    for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return name;
  }

  SweepTable& table_;
  std::set<std::string> taken_;
  std::map<std::string, std::size_t> places_;
};

/// A result that other points did not state gets a column of its own; theirs stay empty.
void add_results(const nlohmann::json& result, ResultColumns& columns,
                 std::vector<SweepCell>& row) {
  for (const nlohmann::json& one : result.value("results", nlohmann::json::array())) {
    const std::string name = one.at("name");
    if (depends_on_machine(name)) continue;
    const std::size_t place = columns.of(name, one.at("unit"));
    // Rows grow with the columns; read_table() makes them equally long at the end.
    row.resize(std::max(row.size(), place + 1));
    row[place] = cell_of(one.at("value"));
  }
}

/// RFC 4180. Unlike an export for people no formula is defused: a table that programs read keeps
/// its texts.
std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

std::string header_of(const SweepColumn& column) {
  return column.unit.empty() ? column.name : column.name + " (" + column.unit + ")";
}

void bind_cell(Statement& insert, int place, const SweepCell& cell) {
  if (const auto* const text = std::get_if<std::string>(&cell))
    insert.bind(place, *text);
  else
    insert.bind(place, number_in(cell));  // a NaN becomes NULL
}

/// Columns without a type: SQLite keeps each value as it is bound.
void fill_points(Database& database, const SweepTable& table) {
  std::string names;
  std::string marks;
  std::string shown;
  for (const SweepColumn& column : table.columns) {
    const std::string comma = names.empty() ? "" : ", ";
    names += comma + quoted_identifier(column.name);
    marks += comma + "?";
    shown += comma + quoted_identifier(column.name) + " AS " + quoted_identifier(header_of(column));
  }
  database.execute("CREATE TABLE points (" + names + ")");
  // For people: queries are easier to write with the plain names.
  database.execute("CREATE VIEW points_with_units AS SELECT " + shown + " FROM points");
  Statement insert = database.prepare("INSERT INTO points VALUES (" + marks + ")");
  for (const auto& row : table.rows) {
    for (std::size_t i = 0; i < row.size(); ++i) bind_cell(insert, static_cast<int>(i) + 1, row[i]);
    insert.run();
  }
}

void fill_columns(Database& database, const SweepTable& table) {
  database.execute("CREATE TABLE columns (position INTEGER, name TEXT, unit TEXT, role TEXT)");
  Statement insert = database.prepare("INSERT INTO columns VALUES (?, ?, ?, ?)");
  std::int64_t position = 0;
  for (const SweepColumn& column : table.columns)
    insert.bind(1, position++)
        .bind(2, column.name)
        .bind(3, column.unit)
        .bind(4, to_string(column.role)),
        insert.run();
}

/// What all points have in common, for a reader that has the database alone.
void fill_fixed(Database& database, const nlohmann::json& head) {
  database.execute("CREATE TABLE fixed (name TEXT, value, unit TEXT)");
  Statement insert = database.prepare("INSERT INTO fixed VALUES (?, ?, ?)");
  const auto add = [&insert](const std::string& name, const SweepCell& value,
                             const std::string& unit) {
    insert.bind(1, name);
    bind_cell(insert, 2, value);
    insert.bind(3, unit).run();
  };
  add("protocol", head.at("protocol").at("name").get<std::string>(), "");
  add("rig", head.at("rig").at("name").get<std::string>(), "");
  for (const nlohmann::json& axis : head.at("axes")) {
    if (axis.at("varied").get<bool>()) continue;
    const nlohmann::json& value = axis.at("values").at(0);
    const std::string unit = axis.at("unit");
    add(axis.at("name"), value.is_array() ? SweepCell(list_text(value, unit)) : cell_of(value),
        value.is_array() ? "" : unit);
  }
}

}  // namespace

const char* to_string(ColumnRole role) {
  return role == ColumnRole::about ? "about" : role == ColumnRole::varied ? "varied" : "result";
}

std::size_t SweepTable::column(const std::string& name) const {
  for (std::size_t i = 0; i < columns.size(); ++i)
    if (columns[i].name == name) return i;
  throw std::out_of_range(name);
}

// A seed is a text: 64 bits do not fit into a double.
SweepTable read_table(const PointFolder& folder) {
  SweepTable table;
  table.columns = {{"point", ""}, {"key", ""}, {"repeat", ""}, {"seed", ""}};
  std::vector<nlohmann::json> varied;
  for (const nlohmann::json& axis : folder.head().at("axes"))
    if (axis.at("varied").get<bool>()) varied.push_back(axis);
  for (const nlohmann::json& axis : varied)
    for (const SweepColumn& column : columns_of(axis)) table.columns.push_back(column);
  for (const char* const name : {"outcome", "exit_code", "reason"})
    table.columns.push_back({name, ""});
  ResultColumns results(table);
  // In the order of the plan, not in that of finishing, which differs from machine to machine.
  for (std::size_t point = 0; point < folder.points().size(); ++point) {
    const PlannedPoint& planned = folder.points()[point];
    std::vector<SweepCell> row{static_cast<double>(point), planned.key,
                               planned.what.at("repeat").get<double>(),
                               std::to_string(planned.what.at("seed").get<std::uint64_t>())};
    for (const nlohmann::json& axis : varied)
      add_values(axis, planned.what.at("values").at(axis.at("name").get<std::string>()), row);
    const nlohmann::json result = folder.result(point).value_or(nlohmann::json::object());
    table.missing += result.empty() ? 1 : 0;
    row.emplace_back(result.value("outcome", "missing"));
    row.push_back(result.contains("exit_code") ? cell_of(result["exit_code"]) : SweepCell());
    row.emplace_back(result.value("reason", ""));
    add_results(result, results, row);
    table.rows.push_back(std::move(row));
    // These two depend on the machine. They are for the page, and in no table.
    table.wall_times.push_back(result.value("wall_time", kNothing));
    table.runs.push_back(below_runs(folder, point, result.value("run", "")));
  }
  for (auto& row : table.rows) row.resize(table.columns.size());
  return table;
}

double number_in(const SweepCell& cell) {
  const double* const number = std::get_if<double>(&cell);
  return number != nullptr ? *number : kNothing;
}

// The shortest text that reads back as the same double.
std::string text_in(const SweepCell& cell) {
  if (const auto* const text = std::get_if<std::string>(&cell)) return *text;
  const double number = number_in(cell);
  return std::isnan(number) ? "" : fmt::format("{}", number);
}

// CRLF, as RFC 4180 has it.
std::string csv_of(const SweepTable& table) {
  std::string csv;
  for (std::size_t i = 0; i < table.columns.size(); ++i)
    csv += (i == 0 ? "" : ",") + csv_cell(header_of(table.columns[i]));
  csv += "\r\n";
  for (const auto& row : table.rows) {
    for (std::size_t i = 0; i < row.size(); ++i)
      csv += (i == 0 ? "" : ",") + csv_cell(text_in(row[i]));
    csv += "\r\n";
  }
  return csv;
}

// Made in the folder for temporary files: SQLite's locks fail on some shared folders. Filled in one
// transaction in one order, a database has the same bytes each time.
std::string sqlite_of(const SweepTable& table, const nlohmann::json& head) {
  const fs::path file = fs::temp_directory_path() / ("vitreo_sweep_" + random_hex(12) + ".sqlite");
  std::string bytes;
  try {
    Database database(file.string(), Database::Mode::create);
    // Without a journal file: a database that is half made is thrown away.
    database.execute("PRAGMA journal_mode=MEMORY");
    database.execute("BEGIN");
    fill_points(database, table);
    fill_columns(database, table);
    fill_fixed(database, head);
    database.execute("COMMIT");
    database.close();
    bytes = read_whole_file(file);
  } catch (...) {
    std::error_code ignored;
    fs::remove(file, ignored);
    throw;
  }
  fs::remove(file);
  return bytes;
}

/// Each file is replaced as a whole. A kill between the two leaves tables of two moments, which
/// --resume makes anew.
void write_tables(const SweepTable& table, const PointFolder& folder) {
  publish(folder.folder() / "sweep.csv", csv_of(table));
  publish(folder.folder() / "sweep.sqlite", sqlite_of(table, folder.head()));
}

}  // namespace vitreo
