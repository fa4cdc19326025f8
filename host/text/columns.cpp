// SPDX-License-Identifier: Apache-2.0
#include "host/text/columns.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

namespace vitreo {
namespace {

// A number of a column has at most so many digits before its point, if a larger unit is there.
constexpr double kLongest = 1e5;
// Below this a number begins with zeros: the next smaller unit is taken.
constexpr double kShortest = 0.1;
// A column whose smallest value is far below the largest would otherwise get more decimals than a
// reader can use.
constexpr int kMostDecimals = 6;

/// Magnitudes of the finite values that are more than what a subtraction of doubles leaves.
std::vector<double> magnitudes(const std::vector<double>& in_si, double smallest_unit) {
  std::vector<double> sizes;
  for (const double value : in_si)
    if (std::isfinite(value) && std::fabs(value) >= 1e-8 * smallest_unit)
      sizes.push_back(std::fabs(value));
  return sizes;
}

// Times of a column are decimal numbers, since "1 min 02 s" cannot stand beneath "0.8 s"; from 2 h
// and from 10 min on they are in h and min.
std::vector<DisplayUnit> units_of_columns(std::string_view unit) {
  std::vector<DisplayUnit> units = display_units(unit);
  if (unit == "s") units.insert(units.begin(), {{*find_unit("h"), 7200}, {*find_unit("min"), 600}});
  return units;
}

/// The power of ten of the first digit of a number that is shown with `digits` of them.
/// By way of the printed text and not by log10(): 9.996 with three digits is 1.00e+01, one place
/// more than its logarithm says.
int exponent_of(double number, int digits) {
  const std::string text = fmt::format("{:.{}e}", std::fabs(number), digits - 1);
  return std::stoi(text.substr(text.find('e') + 1));
}

/// Decimals that show `digits` significant digits of a number.
int decimals_for(double number, int digits) {
  return number == 0 ? 0 : std::max(0, digits - 1 - exponent_of(number, digits));
}

/// Never "-0.00".
/// A minus in front of zeros would claim a direction that the digits do not show.
std::string fixed(double number, int decimals) {
  if (!std::isfinite(number)) return format_number(number);
  std::string text = fmt::format("{:.{}f}", number, decimals);
  const bool zero = text.find_first_not_of("-0.") == std::string::npos;
  if (zero && text.starts_with('-')) text.erase(0, 1);
  return text;
}

/// Zeros with which all numbers end, and points that nothing follows.
void strip_common_zeros(std::vector<std::string>& numbers, int decimals) {
  for (; decimals > 0; --decimals) {
    if (std::any_of(numbers.begin(), numbers.end(), [](const std::string& number) {
          return number.find('.') != std::string::npos && !number.ends_with('0');
        }))
      return;
    for (std::string& number : numbers) {
      if (number.find('.') == std::string::npos) continue;
      number.pop_back();
      if (number.ends_with('.')) number.pop_back();
    }
  }
}

// Decimals for `digits` of the largest and two of the smallest, and no more than kMostDecimals
// unless the largest needs them. In a unit with a prefix numbers below 1e-8 count as zero: they are
// what a subtraction left.
ShownColumn column_in(const std::vector<double>& in_si, const Unit& unit, int digits) {
  std::vector<double> numbers;
  for (const double value : in_si) numbers.push_back(unit.from_si(value));
  double largest = 0;
  double smallest = std::numeric_limits<double>::infinity();
  for (const double size : magnitudes(numbers, unit.factor < 1 ? 1 : 0)) {
    largest = std::max(largest, size);
    if (size > 0) smallest = std::min(smallest, size);
  }
  int decimals = decimals_for(largest, digits);
  if (std::isfinite(smallest)) decimals = std::max(decimals, decimals_for(smallest, 2));
  decimals = std::min(decimals, std::max(kMostDecimals, decimals_for(largest, digits)));
  ShownColumn shown;
  for (const double number : numbers) shown.numbers.push_back(fixed(number, decimals));
  strip_common_zeros(shown.numbers, decimals);
  shown.unit = print_unit(unit.symbol);
  return shown;
}

/// A cell of a table that is a number with a unit.
struct Cell {
  double value;  // SI
  std::string dimension;
  std::string symbol;
  int digits;  // significant ones
};

// All digits from the first that is not zero: "20" has two, as the one who wrote it may have meant.
int significant_digits(std::string_view number) {
  number = number.substr(0, number.find_first_of("eE"));
  int digits = 0;
  bool leading = true;
  for (const char c : number) {
    if (c < '0' || c > '9') continue;
    leading = leading && c == '0';
    digits += leading ? 0 : 1;
  }
  return std::max(digits, 1);
}

/// "1 min 02 s" and "1 h 02 min" have two numbers; SI.
/// The sign stands once, in front: "-1 min 02 s" is -62 s.
std::optional<double> long_time(const std::string& text) {
  const std::size_t hours = text.find(" h ");
  const std::size_t split = hours != std::string::npos ? hours + 2 : text.find(" min ") + 4;
  if (hours == std::string::npos && text.find(" min ") == std::string::npos) return std::nullopt;
  const auto first = parse_quantity(text.substr(0, split));
  const auto second = parse_quantity(text.substr(split));
  const bool times = first && second && first->dimension == "s" && second->dimension == "s";
  if (!times) return std::nullopt;
  return first->value + (text.starts_with('-') ? -second->value : second->value);
}

// Nothing for a bare number: without a unit it cannot be compared with others. A long time counts
// in its smaller part, "1 min 02 s" as 62 s of two digits.
std::optional<Cell> read_cell(std::string text) {
  if (text.starts_with("\u2212")) text.replace(0, 3, "-");
  if (const auto time = long_time(text)) {
    const bool hours = text.find(" h ") != std::string::npos;
    const double steps = std::fabs(*time) / (hours ? 60 : 1);
    return Cell{*time, "s", "", significant_digits(fmt::format("{:.0f}", steps))};
  }
  const auto quantity = parse_quantity(text);
  if (!quantity || quantity->bare || quantity->dimension.empty()) return std::nullopt;
  const std::size_t end = text.find_first_not_of("+-0123456789.");
  return Cell{quantity->value, quantity->dimension, text.substr(end),
              significant_digits(text.substr(0, end))};
}

/// "at most 3 mm", "± 20 um (rounding)", "0.1 mm/s to 30 um/s", "12.3 mm".
struct CellText {
  std::string prefix;
  std::vector<Cell> parts;  // of one dimension
  std::string suffix;
};

// All parts must be quantities of one dimension; otherwise the whole cell stays as it is.
std::optional<CellText> read_text(std::string text) {
  CellText read;
  for (const std::string_view prefix : {"\u00b1 ", "at most ", "at least "}) {
    if (!text.starts_with(prefix)) continue;
    read.prefix = prefix;
    text.erase(0, prefix.size());
  }
  if (const std::size_t remark = text.find(" ("); remark != std::string::npos) {
    read.suffix = text.substr(remark);
    text.erase(remark);
  }
  constexpr std::string_view kTo = " to ";
  const std::size_t to = text.find(kTo);
  std::vector<std::string> parts{text.substr(0, to)};
  if (to != std::string::npos) parts.push_back(text.substr(to + kTo.size()));
  for (const std::string& part : parts) {
    const auto cell = read_cell(part);
    if (!cell || (!read.parts.empty() && read.parts.front().dimension != cell->dimension))
      return std::nullopt;
    read.parts.push_back(*cell);
  }
  return read;
}

std::string in_unit(const Cell& cell, const Unit& unit) {
  const double number = unit.from_si(cell.value);
  return with_unit({fixed(number, decimals_for(number, cell.digits)), print_unit(unit.symbol)});
}

/// More than five decades, as the limits of a pixel and of a pupil distance: no unit shows both.
bool too_wide(const std::vector<double>& values) {
  double least = INFINITY, most = 0;
  for (const double value : values) {
    if (value == 0 || !std::isfinite(value)) continue;
    least = std::min(least, std::fabs(value));
    most = std::max(most, std::fabs(value));
  }
  return most > 1e5 * least;
}

}  // namespace

// First the unit that fits the largest value; then smaller ones as long as the smallest would begin
// with a zero after the point and the largest stays below kLongest. 1 - 1e-12: a millimeter that
// was computed may be one bit short of 1e-3. All zeros: the unit in which zero is shown.
std::optional<Unit> column_unit(const std::vector<double>& in_si, std::string_view unit) {
  const std::vector<DisplayUnit> units = units_of_columns(unit);
  if (units.empty()) return std::nullopt;
  const std::vector<double> sizes = magnitudes(in_si, units.back().unit.factor);
  if (sizes.empty()) return find_unit(show_quantity(0, unit).unit);
  const auto [smallest, largest] = std::minmax_element(sizes.begin(), sizes.end());
  std::size_t i = 0;
  // A temperature in °C stands beside no difference in K: all are temperatures, or all in K.
  const auto fits = [&](const DisplayUnit& one) {
    const double size = one.unit.offset != 0 ? *smallest : *largest;
    return size >= one.from * (1 - 1e-12);
  };
  while (i + 1 < units.size() && !fits(units[i])) ++i;
  while (units[i].unit.offset == 0 && i + 1 < units.size() &&
         *smallest / units[i].unit.factor < kShortest &&
         *largest / units[i + 1].unit.factor < kLongest)
    ++i;
  return units[i].unit;
}

// A unit that is not known stands behind the numbers as it came.
ShownColumn show_column(const std::vector<double>& in_si, std::string_view unit, int digits) {
  if (const auto shared = column_unit(in_si, unit)) return column_in(in_si, *shared, digits);
  return column_in(in_si, {unit, unit, 1, ""}, digits);
}

std::string format_range(double min, double max, std::string_view unit, int digits) {
  // More than three decades apart one of the two ends would have zeros or five digits: each gets
  // its own unit.
  constexpr double kFar = 1e3;
  const double small = std::min(std::fabs(min), std::fabs(max));
  const bool far = small > 0 && std::max(std::fabs(min), std::fabs(max)) > kFar * small;
  const auto shared = far ? std::nullopt : column_unit({min, max}, unit);
  if (!shared)
    return format_quantity(min, unit, digits) + " to " + format_quantity(max, unit, digits);
  const auto shown = [&](double end) { return format_number(shared->from_si(end), digits); };
  return shown(min) + " to " + with_unit({shown(max), print_unit(shared->symbol)});
}

// JCGM 100:2008, 7.2.6: both to the place of the uncertainty's second digit. `place` is negative
// where that is in front of the point: 12 340 ± 420.
Shown show_measured_in(double in_si, double uncertainty, const Unit& unit) {
  constexpr int kDigits = 2;
  const double number = unit.from_si(in_si);
  const double spread = uncertainty / unit.factor;
  const int place = kDigits - 1 - exponent_of(spread, kDigits);  // of the last digit that counts
  const auto shown = [place](double what) {
    if (place >= 0) return fixed(what, place);
    const double step = std::pow(10, -place);
    return fixed(std::nearbyint(what / step) * step, 0);
  };
  return {shown(number) + " \u00b1 " + shown(spread), print_unit(unit.symbol)};
}

Shown show_measured(double in_si, double uncertainty, std::string_view unit, int digits) {
  if (!std::isfinite(in_si) || !std::isfinite(uncertainty) || uncertainty <= 0)
    return show_quantity(in_si, unit, digits);
  // The uncertainty of a temperature is a difference: only the value chooses.
  const bool temperature = unit == "K" || unit == "degC";
  const auto shared = column_unit(
      temperature ? std::vector{in_si} : std::vector{std::max(std::fabs(in_si), uncertainty)},
      unit);
  return show_measured_in(in_si, uncertainty, shared.value_or(Unit{unit, unit, 1, ""}));
}

std::string format_measured(double in_si, double uncertainty, std::string_view unit, int digits) {
  return with_unit(show_measured(in_si, uncertainty, unit, digits));
}

// Two passes: a unit can be chosen only when all values of its dimension are known. Where a
// dimension came with one unit alone, nothing is rewritten: the author's digits stay.
std::vector<std::string> cells_in_one_unit(std::vector<std::string> cells) {
  std::vector<std::optional<CellText>> read;
  std::map<std::string, std::vector<double>> values;
  std::map<std::string, std::set<std::string>> symbols;
  for (const std::string& text : cells) {
    read.push_back(read_text(text));
    if (!read.back()) continue;
    for (const Cell& cell : read.back()->parts) {
      values[cell.dimension].push_back(cell.value);
      symbols[cell.dimension].insert(cell.symbol);
    }
  }
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (!read[i]) continue;
    const std::string& dimension = read[i]->parts.front().dimension;
    const auto unit = column_unit(values[dimension], dimension);
    if (!unit || symbols[dimension].size() < 2 || too_wide(values[dimension])) continue;
    std::string text = read[i]->prefix;
    for (const Cell& cell : read[i]->parts)
      text += (&cell == &read[i]->parts.front() ? "" : " to ") + in_unit(cell, *unit);
    cells[i] = text + read[i]->suffix;
  }
  return cells;
}

// A word is a unit behind a number ("30 deg") or at the head of a bracket or after a comma ("error
// (um)", "x, um"); elsewhere "min" and "h" may be words. The degree sign follows its number without
// a blank.
std::string with_print_units(const std::string& text) {
  constexpr std::string_view kEnds = " ,;:)]";
  std::string made;
  for (std::size_t at = 0; at < text.size();) {
    const char before = made.empty() ? ' ' : made.back();
    const std::size_t end = std::min(text.find_first_of(kEnds, at), text.size());
    const std::string_view word = std::string_view(text).substr(at, end - at);
    const std::size_t behind = made.find_last_not_of(' ');
    const char last = behind == std::string::npos ? ' ' : made[behind];
    const bool number = last >= '0' && last <= '9' && before == ' ';
    // "us" is a word, too.
    const bool named = (last == ',' && word != "us") || before == '(' || before == '[';
    const std::string unit = (number || named) && find_unit(word) ? print_unit(word) : "";
    if (unit.empty() || unit == word) {
      // A bracket within a word ends it too: "error(um)".
      const std::size_t next = word.find_first_of("([");
      const std::size_t taken =
          next == std::string_view::npos ? std::min(end + 1, text.size()) : at + next + 1;
      made += text.substr(at, taken - at);
      at = taken;
      continue;
    }
    if (number && unit == "\u00b0") made.erase(behind + 1);
    made += unit;
    at = end;
  }
  return made;
}

// A sigma whose value was not stated, or that is zero or not finite, stays a result of its own:
// nothing a script states is hidden.
std::vector<NamedQuantity> join_uncertainties(const std::vector<NamedQuantity>& quantities) {
  const auto named = [&](const std::string& name, const std::string& unit) {
    return std::find_if(quantities.begin(), quantities.end(), [&](const NamedQuantity& one) {
      return one.name == name && one.unit == unit;
    });
  };
  constexpr std::string_view kSigma = "_sigma";
  std::vector<NamedQuantity> joined;
  for (const NamedQuantity& one : quantities) {
    const bool sigma = one.name.ends_with(kSigma);
    const std::string of = sigma ? one.name.substr(0, one.name.size() - kSigma.size()) : "";
    const auto usable = [](const NamedQuantity& s) {
      return std::isfinite(s.value) && s.value > 0;
    };
    if (sigma && usable(one) && named(of, one.unit) != quantities.end()) continue;
    joined.push_back(one);
    const auto found = named(one.name + std::string(kSigma), one.unit);
    if (found != quantities.end() && usable(*found)) joined.back().uncertainty = found->value;
  }
  return joined;
}

// Grouped by the unit as stated: "um" and "m" are different wishes, though one dimension.
std::vector<Shown> show_list(const std::vector<NamedQuantity>& quantities, int digits) {
  std::map<std::string, std::vector<double>> values;
  for (const NamedQuantity& one : quantities) values[one.unit].push_back(one.value);
  std::vector<Shown> shown;
  for (const NamedQuantity& one : quantities) {
    const std::vector<double>& alike = values.at(one.unit);
    // Plain numbers need not be of a kind, and a single value has the display unit of its size.
    const bool alone = one.unit.empty() || alike.size() == 1 || !std::isfinite(one.value);
    const auto unit = alone ? std::nullopt : column_unit(alike, one.unit);
    if (!unit)
      shown.push_back(show_measured(one.value, one.uncertainty.value_or(0), one.unit, digits));
    else if (one.uncertainty)
      shown.push_back(show_measured_in(one.value, *one.uncertainty, *unit));
    else
      shown.push_back({format_number(unit->from_si(one.value), digits), print_unit(unit->symbol)});
  }
  return shown;
}

}  // namespace vitreo
