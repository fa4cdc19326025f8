// Schema of run.sqlite: each table and column once, with type, unit and meaning. The tables, their
// explanation in each record (table `meaning`) and DATA.md are made from these rows.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

namespace vitreo {

// SQLite's user_version; a change of the tables raises it, and a fixture of the version before goes
// to tests/host/runs/schemas. 0: before versions were written. 2: frames, modules, plots. 3: the
// table result was called figure. 4: bits and offset of a camera. 5: meaning, tags, sample, time
// zero, who ended the run, losses of the cameras.
inline constexpr int kRecordVersion = 5;

struct RecordTable {
  const char* name;
  const char* help;
};

struct RecordColumn {
  const char* table;
  const char* name;
  const char* type;  // SQLite's, with its constraint
  const char* unit;  // "" for what is no number
  const char* help;
};

// Beside these each stream has a table of its own, sample_NAME (RecordFile::add_stream). Times are
// ns of the run's clock. Nested data is JSON. A seed is text, for SQLite's integers end at 2^63
// - 1.
std::span<const RecordTable> record_tables();
std::span<const RecordColumn> record_columns();

/// CREATE TABLE of one table; std::logic_error for an unknown one.
std::string create_table(const std::string& table);
/// Of all tables that each record has: all but `link`, which is made when the first byte of a
/// traced link is recorded.
std::string create_tables();

}  // namespace vitreo
