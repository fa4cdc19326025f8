// Sweep table: a row a point in the order of the plan, the same bytes wherever they ran.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/point_folder.h"

#include <cstddef>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

namespace vitreo {

/// varied, fixed: parameters; result: stated by the runs; about: of the point itself.
enum class ColumnRole { about, varied, result };
const char* to_string(ColumnRole role);

struct SweepColumn {
  std::string name;
  std::string unit;  // SI, "" for plain numbers and texts
  ColumnRole role = ColumnRole::about;
};

/// Nothing, a number (SI) or a text.
using SweepCell = std::variant<std::monostate, double, std::string>;

struct SweepTable {
  std::vector<SweepColumn> columns;
  std::vector<std::vector<SweepCell>> rows;  // one a point, as long as `columns`
  std::vector<double> wall_times;            // s; one a point, NaN where not known; in no file
  std::vector<std::string> runs;             // folders' names; likewise
  std::size_t missing = 0;                   // points without a result
  /// Throws std::out_of_range.
  std::size_t column(const std::string& name) const;
};

/// Of a plan of kind "sweep". Throws SweepError for a mark that is broken.
SweepTable read_table(const PointFolder& folder);

/// The cell as a number; NaN of what is none.
double number_in(const SweepCell& cell);
/// Exactly; "" of nothing.
std::string text_in(const SweepCell& cell);

/// RFC 4180, units in the header: "speed (m/s)".
std::string csv_of(const SweepTable& table);
/// A database of the tables `points`, `columns` (name, unit, role) and `fixed` (parameters with one
/// value), and the view `points_with_units`; its bytes.
std::string sqlite_of(const SweepTable& table, const nlohmann::json& head);

/// sweep.csv and sweep.sqlite in the folder.
void write_tables(const SweepTable& table, const PointFolder& folder);

}  // namespace vitreo
