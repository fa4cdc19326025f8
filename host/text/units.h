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
  double factor;               // SI = number * factor
  std::string_view quantity;   // what it measures, for errors: "a speed", "a length"
};

/// All units, in the order in which they are offered; the unit tables of Lua and the docs are
/// printed from it.
const std::vector<Unit>& units();
/// "µm", "°" and "mm²/s" are found too; "" is the plain number.
std::optional<Unit> find_unit(std::string_view symbol);
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

/// A value in the unit people would choose: {"220", "um"}; {"1 min 02 s", ""} for a time of a
/// minute and more.
struct Shown {
  std::string number;
  std::string unit;
};
Shown show_quantity(double in_si, std::string_view dimension, int digits = 3);

/// For people: "12.3 mm", "220 um", "10 mT", "0.5 mm/s", "1 min 02 s" with `digits` significant
/// digits.
std::string format_quantity(double in_si, std::string_view dimension, int digits = 3);

/// A unit as it is set in print (plots, pages; UTF-8): "µm", "mm²/s", "°", "Pa·s".
std::string print_unit(std::string_view symbol);

}  // namespace vitreo
