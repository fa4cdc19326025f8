// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_groups.h"

#include "host/text/columns.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace vitreo {
namespace {

/// At share `p` of the way through sorted values.
double quantile(const std::vector<double>& sorted, double p) {
  // Linear between neighbors (Hyndman and Fan 1996, definition 7), as numpy and R have it.
  const double place = p * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return std::lerp(sorted[below], sorted[above], place - static_cast<double>(below));
}

/// Labels in one unit: of numbers the shortest that tell them apart.
void label_values(VariedColumn& varied, const std::string& dimension) {
  if (!varied.numeric) {
    for (const SweepCell& value : varied.values) varied.labels.push_back(text_in(value));
    return;
  }
  std::vector<double> numbers;
  for (const SweepCell& value : varied.values) numbers.push_back(number_in(value));
  // The unit is that of the whole column, so that an axis has one.
  const auto unit = column_unit(numbers, dimension);
  varied.unit = unit ? std::string(unit->symbol) : "";
  for (const double number : numbers)
    varied.labels.push_back(format_number(unit ? unit->from_si(number) : number, 4));
}

/// Texts stay in the order of the plan, which is that of the command line.
void order_values(VariedColumn& varied) {
  if (!varied.numeric) return;
  std::sort(varied.values.begin(), varied.values.end(),
            [](const SweepCell& a, const SweepCell& b) { return number_in(a) < number_in(b); });
}

/// By the text of the cell, which tells doubles apart to the last digit.
void place_rows(const SweepTable& table, VariedColumn& varied) {
  // Rows are told apart by this text in the table's files, too.
  std::map<std::string, std::size_t> places;
  for (std::size_t i = 0; i < varied.values.size(); ++i) places[text_in(varied.values[i])] = i;
  for (const auto& row : table.rows)
    varied.places.push_back(places.at(text_in(row[varied.column])));
}

}  // namespace

Spread spread_of(std::vector<double> values) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  // A point that failed leaves no number: its place in a drawing stays empty.
  if (values.empty()) return {kNone, kNone, kNone, 0};
  std::sort(values.begin(), values.end());
  return {quantile(values, 0.5), quantile(values, 0.25), quantile(values, 0.75), values.size()};
}

std::string VariedColumn::title() const {
  return unit.empty() ? name : name + " (" + print_unit(unit) + ")";
}

// Drawn values hardly ever come twice: a map of them would be empty but for its diagonal.
std::vector<VariedColumn> varied_columns(const SweepTable& table) {
  const std::size_t settings = settings_in(table).size();
  std::vector<VariedColumn> all;
  for (std::size_t column = 0; column < table.columns.size(); ++column) {
    // A fixed parameter has one value, and no axis.
    if (table.columns[column].role != ColumnRole::varied) continue;
    VariedColumn varied;
    varied.column = column;
    varied.name = table.columns[column].name;
    varied.numeric = true;
    // In the order of the plan, each value once.
    std::map<std::string, bool> seen;
    for (const auto& row : table.rows) {
      if (!seen.emplace(text_in(row[column]), true).second) continue;
      varied.numeric = varied.numeric && std::holds_alternative<double>(row[column]);
      varied.values.push_back(row[column]);
    }
    if (varied.values.size() < 2) continue;  // a component of a vector that stays
    // More values than half of the settings and than a grid has along one axis: they were drawn,
    // and a cloud of points shows them.
    varied.drawn = varied.numeric && settings > 8 && 2 * varied.values.size() > settings &&
                   varied.values.size() > 12;
    order_values(varied);
    place_rows(table, varied);
    label_values(varied, table.columns[column].unit);
    all.push_back(std::move(varied));
  }
  return all;
}

bool is_completed(const SweepTable& table, std::size_t row) {
  static const std::string kCompleted = "completed";
  const SweepCell& outcome = table.rows[row][table.column("outcome")];
  return std::get<std::string>(outcome) == kCompleted;
}

// One pass over the rows, whatever the number of combinations.
std::vector<std::vector<std::size_t>> group_rows(const SweepTable& table,
                                                 const std::vector<const VariedColumn*>& columns) {
  // A group a combination, in mixed radix: the last column changes fastest.
  std::size_t count = 1;
  for (const VariedColumn* column : columns) count *= column->values.size();
  std::vector<std::vector<std::size_t>> groups(count);
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    if (!is_completed(table, row)) continue;
    std::size_t group = 0;
    for (const VariedColumn* column : columns)
      group = group * column->values.size() + column->places[row];
    groups[group].push_back(row);
  }
  return groups;
}

std::vector<double> numbers_of(const SweepTable& table, std::size_t column,
                               const std::vector<std::size_t>& rows) {
  std::vector<double> numbers;
  for (const std::size_t row : rows) {
    const double number = number_in(table.rows[row][column]);
    // A point that did not state the result has an empty cell, which is a NaN here.
    if (std::isfinite(number)) numbers.push_back(number);
  }
  return numbers;
}

// The unit separator of ASCII stands between the cells, so that two rows cannot be joined to one
// key.
std::vector<std::vector<std::size_t>> settings_in(const SweepTable& table) {
  std::vector<std::vector<std::size_t>> settings;
  std::map<std::string, std::size_t> places;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    std::string key;
    for (std::size_t column = 0; column < table.columns.size(); ++column)
      if (table.columns[column].role == ColumnRole::varied)
        key += text_in(table.rows[row][column]) + '\x1f';
    const auto [place, is_new] = places.emplace(key, settings.size());
    if (is_new) settings.emplace_back();
    settings[place->second].push_back(row);
  }
  return settings;
}

}  // namespace vitreo
