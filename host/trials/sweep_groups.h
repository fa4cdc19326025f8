// Sweep groups: the points of a table by setting, and what their repeats say together.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/sweep_table.h"

#include <cstddef>
#include <string>
#include <vector>

namespace vitreo {

/// Of several numbers: median and quartiles by linear interpolation (Hyndman and Fan 1996, type 7);
/// NaN of none.
struct Spread {
  double median = 0;
  double low = 0;   // first quartile
  double high = 0;  // third
  std::size_t count = 0;
};
Spread spread_of(std::vector<double> values);

/// A varied column with the values that stand in it.
struct VariedColumn {
  std::size_t column = 0;
  std::string name;                   // "speed"
  std::string unit;                   // as it is shown, "mm/s"; "" for plain numbers and texts
  bool numeric = false;               // all are numbers
  bool drawn = false;                 // hardly any value comes twice
  std::vector<SweepCell> values{};    // each once: numbers ascending, texts as they come
  std::vector<std::string> labels{};  // in `unit`
  std::vector<std::size_t> places{};  // of each row's value among them
  std::string title() const;          // "speed (mm/s)"
};
std::vector<VariedColumn> varied_columns(const SweepTable& table);

/// Rows that completed, by their values in `columns`: as many groups as there are combinations, the
/// last column's value changing fastest.
std::vector<std::vector<std::size_t>> group_rows(const SweepTable& table,
                                                 const std::vector<const VariedColumn*>& columns);

/// The numbers of a column in those rows, without NaN.
std::vector<double> numbers_of(const SweepTable& table, std::size_t column,
                               const std::vector<std::size_t>& rows);

/// Rows by setting, in the order of the table; those that did not complete, too.
std::vector<std::vector<std::size_t>> settings_in(const SweepTable& table);

bool is_completed(const SweepTable& table, std::size_t row);

}  // namespace vitreo
