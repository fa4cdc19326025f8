// Units of the user interface: parsing and printing of quantities. Inside, every number is SI.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

/// A unit that people may write. `dimension` is the SI unit it measures in ("m", "m/s", "T", "A",
/// "s", "rad", "Hz", "N", "K", "kg", "V", "m^2/s", "kg/m^3", "Pa s"; "" for plain numbers).
struct Unit {
  std::string_view symbol;     // "um/s"
  std::string_view dimension;  // "m/s"
  double factor;               // SI = number * factor + offset
  std::string_view quantity;   // what it measures, for errors: "a speed", "a length"
  double offset = 0;           // 273.15 for "degC"
  double to_si(double number) const { return number * factor + offset; }
  double from_si(double in_si) const { return (in_si - offset) / factor; }
};

/// All units, in the order in which they are offered; the unit tables of Lua and the docs are
/// printed from it.
const std::vector<Unit>& units();
/// "µm", "°" and "mm²/s" are found too; "" is the plain number. So are "degC" and "°C", which
/// units() leaves out: 20 * units.degC would be no temperature.
std::optional<Unit> find_unit(std::string_view symbol);
/// The SI unit that a declared one measures in: "m" of "um", "" of "%"; what is no unit stays.
std::string si_unit(std::string_view symbol);
/// The unit's name in Lua's table `units`: mm_per_s; "" where it makes no name.
std::string unit_name(std::string_view symbol);
/// "a speed" for "m/s"; the dimension itself where it has no name.
std::string quantity_name(std::string_view dimension);

/// A number with its unit, as "0.5mm/s", "10 mT", "-3"; nothing when it is not one. Locale-free; no
/// nan, no inf.
struct Quantity {
  double value;  // SI
  std::string dimension;
  bool bare;  // written without a unit
};
std::optional<Quantity> parse_quantity(std::string_view text);

/// A number at `digits` significant digits, without trailing zeros and without an exponent where
/// people can do without.
std::string format_number(double number, int digits = 3);

/// A display unit: used from `from` (SI) upwards.
struct DisplayUnit {
  Unit unit;
  double from;
};
/// The display units of a dimension, largest first. Of a declared unit that is no dimension ("um",
/// "%", "degC"), and of a dimension without display units: that one. Empty for what is no unit.
std::vector<DisplayUnit> display_units(std::string_view unit);

/// A value as people read it, and its unit in print: {"220", "µm"}; {"1 min 02 s", ""} for a time
/// of 59.5 s and more, which in whole seconds is a minute.
struct Shown {
  std::string number;
  std::string unit;
};
/// `unit`: a dimension (SI), shown in the display unit of that size, or a declared unit such as
/// "um", "%" or "degC", which is kept. A temperature of 200 K and more (as rounded to `digits`)
/// is shown in °C; what is smaller or negative is a difference and stays in K.
Shown show_quantity(double in_si, std::string_view unit, int digits = 3);

/// Number and unit, joined by `space` unless the unit follows without one: "30°".
std::string with_unit(const Shown& shown, std::string_view space = " ");

/// For people (terminal, page, report): "12.3 mm", "220 µm", "30°", "0.5 mm/s", "1 min 02 s" with
/// `digits` significant digits.
std::string format_quantity(double in_si, std::string_view unit, int digits = 3);

/// In the characters of the units' table, as parse_quantity() reads it: "220 um", "30 deg", "62 s".
/// For arguments that are typed back, and for files that programs read.
std::string plain_quantity(double in_si, std::string_view unit, int digits = 3);

/// A unit as it is set in print (plots, pages; UTF-8): "µm", "mm²/s", "°", "°C", "Pa·s".
std::string print_unit(std::string_view symbol);

}  // namespace vitreo
