// SPDX-License-Identifier: Apache-2.0
#include "host/text/columns.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace vitreo {
namespace {

// A number of a column has at most so many digits before its point, if a larger unit is there.
constexpr double kLongest = 1e5;
// Below this a number of three digits is mostly zeros: the next smaller unit is taken.
constexpr double kShortest = 0.01;
constexpr int kMostDecimals = 6;

/// Magnitudes of the finite values that are more than what a subtraction of doubles leaves.
std::vector<double> magnitudes(const std::vector<double>& in_si, double smallest_unit) {
  std::vector<double> sizes;
  for (const double value : in_si)
    if (std::isfinite(value) && std::fabs(value) >= 1e-8 * smallest_unit)
      sizes.push_back(std::fabs(value));
  return sizes;
}

std::vector<DisplayUnit> units_of_columns(std::string_view unit) {
  std::vector<DisplayUnit> units = display_units(unit);
  if (unit == "s") units.insert(units.begin(), {{*find_unit("h"), 7200}, {*find_unit("min"), 600}});
  return units;
}

/// The power of ten of the first digit of a number that is shown with `digits` of them.
int exponent_of(double number, int digits) {
  const std::string text = fmt::format("{:.{}e}", std::fabs(number), digits - 1);
  return std::stoi(text.substr(text.find('e') + 1));
}

/// Decimals that show `digits` significant digits of a number.
int decimals_for(double number, int digits) {
  return number == 0 ? 0 : std::max(0, digits - 1 - exponent_of(number, digits));
}

/// Never "-0.00".
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

}  // namespace

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

ShownColumn show_column(const std::vector<double>& in_si, std::string_view unit, int digits) {
  if (const auto shared = column_unit(in_si, unit)) return column_in(in_si, *shared, digits);
  return column_in(in_si, {unit, unit, 1, ""}, digits);
}

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
