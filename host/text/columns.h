// Quantities that are read together: a column in one unit, a value with its uncertainty, a list of
// named values. host/view/page/src/format.js has the same rules.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/text/units.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

/// The display unit for several values of one dimension: that of the largest, or a smaller one
/// where the smallest value would begin after the first decimal (but no number gets more than five
/// digits before its point). Times are in h, min, s and below. Nothing for what is no unit.
std::optional<Unit> column_unit(const std::vector<double>& in_si, std::string_view unit);

/// One unit, and as many decimals in each number: the largest has at least `digits` significant
/// digits, the smallest at least two; zeros that all end with are left out.
struct ShownColumn {
  std::vector<std::string> numbers;
  std::string unit;  // in print: "µm"
};
ShownColumn show_column(const std::vector<double>& in_si, std::string_view unit, int digits = 3);

/// For people: "0.5 to 60 s"; with two units where the ends are far apart: "1 µm to 10 mm".
std::string format_range(double min, double max, std::string_view unit, int digits = 3);

/// A value with its standard uncertainty, both SI: the uncertainty to two significant digits, the
/// value to the same decimal place (JCGM 100:2008, 7.2.6): {"12.34 ± 0.42", "µm"}. Without a
/// positive and finite uncertainty as show_quantity().
Shown show_measured(double in_si, double uncertainty, std::string_view unit, int digits = 3);
/// The same in a unit that is given, as the neighbours in a column have it.
Shown show_measured_in(double in_si, double uncertainty, const Unit& unit);
std::string format_measured(double in_si, double uncertainty, std::string_view unit,
                            int digits = 3);

/// Cells that are quantities ("980 um", "1 min 02 s", "at most 3 mm", "20 um to 1 mm"): those of
/// one dimension in one unit, each with the significant digits it came with. Other cells, and those
/// of a dimension with one unit only, or of sizes as um and m, stay.
std::vector<std::string> cells_in_one_unit(std::vector<std::string> cells);

/// A script's own text with its units as in print: "137 um" and "error (um)" with µ, "30 deg" with
/// °.
std::string with_print_units(const std::string& text);

/// A value with its name, and its uncertainty where it has one.
struct NamedQuantity {
  std::string name;
  double value;      // SI
  std::string unit;  // as show_quantity() takes it
  std::optional<double> uncertainty{};
};

/// Joins "depth" and "depth_sigma" of the same unit to one value with its uncertainty.
std::vector<NamedQuantity> join_uncertainties(const std::vector<NamedQuantity>& quantities);

/// One for each, in their order: those of one dimension are in one unit.
std::vector<Shown> show_list(const std::vector<NamedQuantity>& quantities, int digits = 3);

}  // namespace vitreo
