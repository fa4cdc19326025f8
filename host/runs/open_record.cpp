// SPDX-License-Identifier: Apache-2.0
#include "host/runs/open_record.h"

#include "host/record/record_schema.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// Asked before SQLite is, which has one and the same text for all of these errors.
std::string file_of(const fs::path& folder) {
  if (!fs::exists(folder)) throw RecordError(folder.string() + ": there is no such folder");
  const fs::path file = folder / "run.sqlite";
  if (!fs::is_regular_file(file))
    throw RecordError(folder.string() + ": is no run: it has no run.sqlite");
  return file.string();
}

/// The column of an expression over one: its first word, or the first behind a parenthesis.
std::string column_in(const std::string& expression) {
  const std::size_t parenthesis = expression.find('(');
  const std::size_t begin = parenthesis == std::string::npos ? 0 : parenthesis + 1;
  std::size_t end = begin;
  while (end < expression.size() &&
         (std::isalnum(static_cast<unsigned char>(expression[end])) != 0 || expression[end] == '_'))
    ++end;
  return expression.substr(begin, end - begin);
}

/// None of a table that is not there.
std::vector<std::string> columns_of_table(Database& database, const std::string& table) {
  std::vector<std::string> names;
  Statement rows = database.prepare("SELECT name FROM pragma_table_info(?)");
  rows.bind(1, table);
  while (rows.step()) names.push_back(rows.text(0));
  return names;
}

bool holds(const std::vector<std::string>& list, const std::string& name) {
  return std::find(list.begin(), list.end(), name) != list.end();
}

}  // namespace

// Read-only: a run that is being recorded has one writer.
OpenRecord::OpenRecord(const fs::path& folder)
    : database_(file_of(folder), Database::Mode::read_only) {
  Statement version = database_.prepare("PRAGMA user_version");
  version.step();
  version_ = static_cast<int>(version.integer(0));
  const std::string file = (folder / "run.sqlite").string();
  if (version_ > kRecordVersion)
    throw RecordError(fmt::format(
        "{}: has record version {}; this program reads up to {}: it wants a newer Vitreo", file,
        version_, kRecordVersion));
  // Another program's database opens as well: every version of a record has these tables.
  for (const char* const table : {"run", "stream", "channel", "event", "stop"})
    if (!has_table(table))
      throw RecordError(
          fmt::format("{}: is no run's record, or was cut: it has no table {}", file, table));
}

bool OpenRecord::has_table(const std::string& table) {
  return !columns_of_table(database_, table).empty();
}

std::vector<std::string> OpenRecord::columns_of(const std::string& table) {
  return columns_of_table(database_, table);
}

/// What a record of an older version lacks reads as NULL, a table as one without rows: one reader
/// serves all versions.
Statement OpenRecord::select(const std::string& table, const std::vector<std::string>& columns,
                             const std::string& tail) {
  const std::vector<std::string> there = columns_of(table);
  std::string list;
  for (const std::string& one : columns)
    list += (list.empty() ? "" : ", ") + (holds(there, column_in(one)) ? one : "NULL");
  if (there.empty()) return database_.prepare("SELECT " + list + " WHERE 0");
  return database_.prepare("SELECT " + list + " FROM " + quoted_identifier(table) + " " + tail);
}

// A parameter that is bound and not used is an error of SQLite's: hence the CASE, which uses it.
// The caller binds by the places in `columns`, also those that an older table lacks.
Statement insert_into(Database& database, const std::string& table,
                      const std::vector<std::string>& columns) {
  const std::vector<std::string> there = columns_of_table(database, table);
  std::string names;
  std::string values;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (!holds(there, columns[i])) continue;
    names += (names.empty() ? "" : ", ") + quoted_identifier(columns[i]);
    values += (values.empty() ? "?" : ", ?") + std::to_string(i + 1);
  }
  // The last parameter's number decides how many may be bound.
  return database.prepare("INSERT INTO " + quoted_identifier(table) + "(" + names + ") SELECT " +
                          values + " WHERE ?" + std::to_string(columns.size()) + " IS NULL OR 1");
}

}  // namespace vitreo
