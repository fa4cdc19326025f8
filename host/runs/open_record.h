// Open record: run.sqlite of a run, of this version of the schema or any before it, read-only.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/files/sqlite.h"

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {

/// A folder that is no run, or whose record is broken. The text names the file.
class RecordError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What an older version did not record is NULL, and a table that it did not have is empty: reading
/// is written once, for the newest.
class OpenRecord {
 public:
  /// Throws RecordError for what is no run's record, and for one of a newer version.
  explicit OpenRecord(const std::filesystem::path& folder);

  int version() const { return version_; }
  bool has_table(const std::string& table);
  /// The table's columns in this order; an expression over one column may stand for a column,
  /// "json_extract(rig, '$.file')". `tail`: ORDER BY and the like.
  Statement select(const std::string& table, const std::vector<std::string>& columns,
                   const std::string& tail = "");
  Database& database() { return database_; }

 private:
  std::vector<std::string> columns_of(const std::string& table);
  Database database_;
  int version_ = 0;
};

/// INSERT of these columns into a table of a record of whatever version: those that it does not
/// have are left out. `row` binds them: bind(column's place among `columns` + 1).
Statement insert_into(Database& database, const std::string& table,
                      const std::vector<std::string>& columns);

}  // namespace vitreo
