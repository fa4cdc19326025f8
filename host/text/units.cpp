// SPDX-License-Identifier: Apache-2.0
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

namespace vitreo {
namespace {

// Of the smallest unit there is: what a subtraction of doubles leaves counts as zero.
constexpr double kNothing = 1e-8;

constexpr double kLargestDifference = 199;  // K; what is larger is a temperature, in degC

constexpr double kDegree = std::numbers::pi / 180;

constexpr Unit kCelsius{"degC", "K", 1, "a temperature", 273.15};

/// Display unit of a dimension: used from `from` (SI) upwards; the smallest of a dimension goes
/// down to zero.
struct Step {
  std::string_view dimension;
  std::string_view symbol;
  double from;
};

// Largest first. Speeds and fields keep their display unit one decade longer: 0.5 mm/s is written,
// not 500 um/s.
constexpr Step kSteps[] = {
    {"m", "m", 1},
    {"m", "mm", 1e-3},
    {"m", "um", 1e-7},
    {"m", "nm", 0},
    {"m/s", "m/s", 1},
    {"m/s", "mm/s", 1e-4},
    {"m/s", "um/s", 0},
    {"m/s^2", "m/s^2", 1},
    {"m/s^2", "mm/s^2", 0},
    {"s", "s", 1},
    {"s", "ms", 1e-3},
    {"s", "us", 1e-6},
    {"s", "ns", 0},
    {"T", "T", 1},
    {"T", "mT", 1e-4},
    {"T", "uT", 0},
    {"T/m", "T/m", 1},
    {"T/m", "mT/m", 0},
    {"A", "A", 0.1},
    {"A", "mA", 1e-4},
    {"A", "uA", 0},
    {"V", "V", 0.1},
    {"V", "mV", 1e-4},
    {"V", "uV", 0},
    {"N", "N", 1},
    {"N", "mN", 1e-3},
    {"N", "uN", 1e-7},
    {"N", "nN", 0},
    {"N m", "N m", 1},
    {"N m", "mN m", 1e-3},
    {"N m", "uN m", 1e-7},
    {"N m", "nN m", 0},
    {"kg", "kg", 1},
    {"kg", "g", 1e-3},
    {"kg", "mg", 1e-6},
    {"kg", "ug", 0},
    {"Hz", "MHz", 1e6},
    {"Hz", "kHz", 1e4},
    {"Hz", "Hz", 0},
    {"rad", "deg", 0},
    {"rad/s", "deg/s", 0},
    {"K", "degC", 200},
    {"K", "K", 0.1},
    {"K", "mK", 0},
    {"m^2/s", "cSt", 0},
    {"Pa s", "Pa s", 1},
    {"Pa s", "mPa s", 0},
    {"A/m", "kA/m", 1e3},
    {"A/m", "A/m", 0},
    {"m^2", "m^2", 1},
    {"m^2", "mm^2", 1e-8},
    {"m^2", "um^2", 0},
    {"m^3", "mL", 1e-7},
    {"m^3", "uL", 0},
    {"m^3/s", "mL/min", 1e-9},
    {"m^3/s", "uL/min", 0},
    {"Pa", "bar", 1e5},
    {"Pa", "mbar", 1},
    {"Pa", "Pa", 0},
    {"W", "W", 1},
    {"W", "mW", 0},
    {"1/m", "D", 0},
};

/// The unit in which zero is shown.
/// Zero has no size to choose by: the unit in which a laboratory speaks of that quantity.
std::string_view usual_symbol(std::string_view dimension) {
  if (dimension == "m") return "mm";
  if (dimension == "m/s") return "mm/s";
  if (dimension == "T") return "mT";
  for (const Step& step : kSteps) {
    if (step.dimension == dimension && step.from <= 1) return step.symbol;
  }
  return dimension;
}

// The tolerance is that of column_unit(). A dimension without rows is its own symbol.
std::string_view symbol_for(double magnitude, std::string_view dimension) {
  if (magnitude == 0) return usual_symbol(dimension);
  for (const Step& step : kSteps) {
    if (step.dimension == dimension && magnitude >= step.from * (1 - 1e-12)) return step.symbol;
  }
  return dimension;
}

/// To `digits` significant digits, by way of the decimal text: what is shown is what was meant.
double rounded(double number, int digits) {
  if (number == 0 || !std::isfinite(number)) return number;
  const std::string text = fmt::format("{:.{}e}", number, digits - 1);
  double result = number;
  std::from_chars(text.data(), text.data() + text.size(), result);
  return result;
}

// Rounded to whole seconds before it is split, or 119.7 s would be "1 min 60 s".
std::string minutes_text(double seconds) {
  const bool negative = seconds < 0;
  const auto whole = static_cast<long long>(std::llround(std::fabs(seconds)));
  const std::string sign = negative ? "-" : "";
  if (whole < 3600) return fmt::format("{}{} min {:02} s", sign, whole / 60, whole % 60);
  return fmt::format("{}{} h {:02} min", sign, whole / 3600, whole % 3600 / 60);
}

std::string replaced(std::string text, std::string_view from, std::string_view to) {
  for (std::size_t at = text.find(from); at != std::string::npos;
       at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
  return text;
}

/// The table's spelling of a symbol: Unicode signs by their ASCII equivalents.
/// Two characters look like µ: U+00B5, the micro sign, and U+03BC, the Greek letter, which
/// keyboards and editors mix. ℃ (U+2103) is one character and °C are two: both are degC.
std::string plain_symbol(std::string_view symbol) {
  constexpr std::pair<std::string_view, std::string_view> kSpellings[] = {
      {"\u2103", "degC"}, {"\u00b5", "u"},  {"\u03bc", "u"},   {"\u00b0", "deg"},
      {"\u00b2", "^2"},   {"\u00b3", "^3"}, {"\u03a9", "ohm"}, {"\u00b7", " "}};
  std::string text(symbol);
  for (const auto& [from, to] : kSpellings) text = replaced(std::move(text), from, to);
  return text;
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kSpace = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kSpace);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kSpace) - first + 1);
}

}  // namespace

const std::vector<Unit>& units() {
  // The first row of a dimension gives it its name (quantity_name()).
  static const std::vector<Unit> table = {
      {"m", "m", 1, "a length"},
      {"cm", "m", 1e-2, "a length"},
      {"mm", "m", 1e-3, "a length"},
      {"um", "m", 1e-6, "a length"},
      {"nm", "m", 1e-9, "a length"},
      {"s", "s", 1, "a time"},
      {"ms", "s", 1e-3, "a time"},
      {"us", "s", 1e-6, "a time"},
      {"ns", "s", 1e-9, "a time"},
      {"min", "s", 60, "a time"},
      {"h", "s", 3600, "a time"},
      {"m/s", "m/s", 1, "a speed"},
      {"cm/s", "m/s", 1e-2, "a speed"},
      {"mm/s", "m/s", 1e-3, "a speed"},
      {"um/s", "m/s", 1e-6, "a speed"},
      {"m/s^2", "m/s^2", 1, "an acceleration"},
      {"mm/s^2", "m/s^2", 1e-3, "an acceleration"},
      {"rad", "rad", 1, "an angle"},
      {"mrad", "rad", 1e-3, "an angle"},
      {"deg", "rad", kDegree, "an angle"},
      {"arcmin", "rad", kDegree / 60, "an angle"},
      {"rad/s", "rad/s", 1, "an angular speed"},
      {"deg/s", "rad/s", kDegree, "an angular speed"},
      {"Hz", "Hz", 1, "a frequency"},
      {"kHz", "Hz", 1e3, "a frequency"},
      {"MHz", "Hz", 1e6, "a frequency"},
      {"1/s", "Hz", 1, "a frequency"},
      {"1/s^2", "1/s^2", 1, "a gain"},
      {"T", "T", 1, "a magnetic field"},
      {"mT", "T", 1e-3, "a magnetic field"},
      {"uT", "T", 1e-6, "a magnetic field"},
      {"T/m", "T/m", 1, "a field gradient"},
      {"mT/m", "T/m", 1e-3, "a field gradient"},
      {"A", "A", 1, "a current"},
      {"mA", "A", 1e-3, "a current"},
      {"uA", "A", 1e-6, "a current"},
      {"A/s", "A/s", 1, "a rate of current"},
      {"A/m", "A/m", 1, "a magnetization"},
      {"kA/m", "A/m", 1e3, "a magnetization"},
      {"V", "V", 1, "a voltage"},
      {"mV", "V", 1e-3, "a voltage"},
      {"uV", "V", 1e-6, "a voltage"},
      {"ohm", "ohm", 1, "a resistance"},
      {"N", "N", 1, "a force"},
      {"mN", "N", 1e-3, "a force"},
      {"uN", "N", 1e-6, "a force"},
      {"nN", "N", 1e-9, "a force"},
      {"N m", "N m", 1, "a torque"},
      {"mN m", "N m", 1e-3, "a torque"},
      {"uN m", "N m", 1e-6, "a torque"},
      {"nN m", "N m", 1e-9, "a torque"},
      {"N/m", "N/m", 1, "a stiffness"},
      {"N s/m", "N s/m", 1, "a drag coefficient"},
      {"A m^2", "A m^2", 1, "a magnetic moment"},
      {"kg", "kg", 1, "a mass"},
      {"g", "kg", 1e-3, "a mass"},
      {"mg", "kg", 1e-6, "a mass"},
      {"ug", "kg", 1e-9, "a mass"},
      {"K", "K", 1, "a temperature"},
      {"mK", "K", 1e-3, "a temperature"},
      {"m^2", "m^2", 1, "an area"},
      {"mm^2", "m^2", 1e-6, "an area"},
      {"um^2", "m^2", 1e-12, "an area"},
      {"m^3", "m^3", 1, "a volume"},
      {"L", "m^3", 1e-3, "a volume"},
      {"mL", "m^3", 1e-6, "a volume"},
      {"uL", "m^3", 1e-9, "a volume"},
      {"m^3/s", "m^3/s", 1, "a flow"},
      {"mL/min", "m^3/s", 1e-6 / 60, "a flow"},
      {"uL/min", "m^3/s", 1e-9 / 60, "a flow"},
      {"mL/h", "m^3/s", 1e-6 / 3600, "a flow"},
      {"uL/h", "m^3/s", 1e-9 / 3600, "a flow"},
      {"Pa", "Pa", 1, "a pressure"},
      {"kPa", "Pa", 1e3, "a pressure"},
      {"mbar", "Pa", 100, "a pressure"},
      {"bar", "Pa", 1e5, "a pressure"},
      {"W", "W", 1, "a power"},
      {"mW", "W", 1e-3, "a power"},
      {"m^2/s", "m^2/s", 1, "a kinematic viscosity"},
      {"mm^2/s", "m^2/s", 1e-6, "a kinematic viscosity"},
      {"cSt", "m^2/s", 1e-6, "a kinematic viscosity"},
      {"Pa s", "Pa s", 1, "a viscosity"},
      {"mPa s", "Pa s", 1e-3, "a viscosity"},
      {"kg/m^3", "kg/m^3", 1, "a density"},
      {"g/cm^3", "kg/m^3", 1e3, "a density"},
      {"D", "1/m", 1, "an optical power"},
      {"1/m", "1/m", 1, "a spatial frequency"},
      {"%", "", 1e-2, "a plain number"},
  };
  return table;
}

// degC is found here and stands in no table: its factor alone would turn 20 degC into 20 K.
std::optional<Unit> find_unit(std::string_view symbol) {
  if (symbol.empty()) return Unit{"", "", 1, "a plain number"};
  const std::string plain = plain_symbol(symbol);
  if (plain == kCelsius.symbol) return kCelsius;
  const auto found = std::find_if(units().begin(), units().end(),
                                  [&](const Unit& unit) { return unit.symbol == plain; });
  if (found == units().end()) return std::nullopt;
  return *found;
}

std::string si_unit(std::string_view symbol) {
  const std::optional<Unit> unit = find_unit(symbol);
  return std::string(unit ? unit->dimension : symbol);
}

// "mm/s" is mm_per_s in Lua's module `units`, "m^2" is m2; empty for what gives no identifier.
std::string unit_name(std::string_view symbol) {
  std::string name;
  for (const char c : symbol) {
    if (c == '/')
      name += "_per_";
    else if (c == ' ')
      name += '_';
    else if (c != '^')
      name += c;
  }
  const bool valid =
      !name.empty() &&
      name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789") ==
          std::string::npos;
  return valid && !std::isdigit(static_cast<unsigned char>(name[0])) ? name : "";
}

// With its article, as errors want it: "must be a length".
std::string quantity_name(std::string_view dimension) {
  if (dimension.empty()) return "a plain number";
  for (const Unit& unit : units()) {
    if (unit.dimension == dimension) return std::string(unit.quantity);
  }
  return std::string(dimension);
}

// number [*] [unit]; the sign + is taken, two signs are not.
std::optional<Quantity> parse_quantity(std::string_view text) {
  text = trimmed(text);
  if (text.starts_with('+')) {
    text.remove_prefix(1);
    if (text.starts_with('-')) return std::nullopt;
  }
  // from_chars also reads "nan" and "inf", which no instrument may be sent.
  const std::size_t first = text.starts_with('-') ? 1 : 0;
  if (first >= text.size() || !(text[first] == '.' || (text[first] >= '0' && text[first] <= '9')))
    return std::nullopt;
  // std::from_chars knows no locale: a decimal comma of the operator's system must not change a
  // current.
  double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc()) return std::nullopt;
  std::string_view symbol = trimmed(text.substr(static_cast<std::size_t>(end - text.data())));
  if (symbol.empty()) return Quantity{number, "", true};
  if (symbol.starts_with('*')) symbol = trimmed(symbol.substr(1));  // "3*s", as scripts write it
  const std::optional<Unit> unit = symbol.empty() ? std::nullopt : find_unit(symbol);
  // 1e308 h is a number, but not in seconds.
  if (!unit || !std::isfinite(unit->to_si(number))) return std::nullopt;
  return Quantity{unit->to_si(number), std::string(unit->dimension), false};
}

// Fixed notation for powers of ten from -4 to 7 (or to `digits`, if that is more), trailing zeros
// cut; outside of it exponential notation.
// Digits in front of the point are never replaced by zeros: 123456 stays, with three digits too.
std::string format_number(double number, int digits) {
  if (std::isnan(number)) return "not a number";
  if (std::isinf(number)) return number > 0 ? "infinity" : "-infinity";
  digits = std::clamp(digits, 1, 17);
  const double value = rounded(number, digits);
  if (value == 0) return "0";
  // 1e-12: log10(1000) may come out a little below 3.
  const int exponent = static_cast<int>(std::floor(std::log10(std::fabs(value)) + 1e-12));
  if (exponent < -4 || exponent > std::max(7, digits)) return fmt::format("{:.{}g}", value, digits);
  const int decimals = std::max(0, digits - 1 - exponent);
  std::string text = fmt::format("{:.{}f}", exponent >= digits ? number : value, decimals);
  if (decimals > 0) {
    text.erase(text.find_last_not_of('0') + 1);
    if (text.ends_with('.')) text.pop_back();
  }
  return text;
}

namespace {

// The rounded value chooses the unit, the exact one is converted: 999.9 um with three digits is 1
// mm. What a subtraction left of a length is shown as 0 in the unit that its size has chosen.
Shown plain_shown(double in_si, std::string_view dimension, int digits) {
  if (!std::isfinite(in_si)) return {format_number(in_si), ""};
  const double value = rounded(in_si, std::clamp(digits, 1, 17));  // 999.9 um is 1 mm
  // Below zero kelvins are a difference, however large.
  const bool difference = dimension == "K" && value < 0;
  const double size = difference ? std::min(-value, kLargestDifference) : std::fabs(value);
  const std::string_view symbol = symbol_for(size, dimension);
  const std::optional<Unit> unit = find_unit(symbol);
  double number = unit ? unit->from_si(in_si) : in_si;
  if (unit && unit->factor < 1 && std::fabs(number) < kNothing) number = 0;
  return {format_number(number, digits), std::string(unit ? unit->symbol : symbol)};
}

}  // namespace

// Only a dimension has several. A declared unit ("um") is a wish, and stands alone.
std::vector<DisplayUnit> display_units(std::string_view unit) {
  std::vector<DisplayUnit> shown;
  for (const Step& step : kSteps)
    if (step.dimension == unit) shown.push_back({*find_unit(step.symbol), step.from});
  if (const auto declared = find_unit(unit); shown.empty() && declared)
    shown.push_back({*declared, 0});
  return shown;
}

// From 59.5 s on, where rounding makes a minute of it.
Shown show_quantity(double in_si, std::string_view unit, int digits) {
  const bool minutes = unit == "s" && std::isfinite(in_si) && std::llround(std::fabs(in_si)) >= 60;
  if (minutes) return {minutes_text(in_si), ""};
  Shown shown = plain_shown(in_si, unit, digits);
  shown.unit = print_unit(shown.unit);
  return shown;
}

std::string with_unit(const Shown& shown, std::string_view space) {
  const bool joined = shown.unit.empty() || shown.unit == "\u00b0";
  return shown.number + std::string(joined ? "" : space) + shown.unit;
}

std::string format_quantity(double in_si, std::string_view unit, int digits) {
  return with_unit(show_quantity(in_si, unit, digits));
}

std::string plain_quantity(double in_si, std::string_view unit, int digits) {
  return with_unit(plain_shown(in_si, unit, digits));
}

// Also of products and powers: "N m" is N·m, "mm^2/s" is mm²/s. A leading u is a prefix only where
// the whole is a unit.
std::string print_unit(std::string_view symbol) {
  if (symbol == "deg") return "\u00b0";
  if (symbol == kCelsius.symbol) return "\u00b0C";
  if (symbol == "ohm") return "\u03a9";
  std::string text(symbol);
  if (text.starts_with('u') && find_unit(text)) text.replace(0, 1, "\u00b5");
  if (text.starts_with("deg/")) text.replace(0, 3, "\u00b0");
  text = replaced(std::move(text), "^2", "\u00b2");
  text = replaced(std::move(text), "^3", "\u00b3");
  return replaced(std::move(text), " ", "\u00b7");
}

}  // namespace vitreo
