// How numbers and quantities are printed against the header's words, and read back.
// SPDX-License-Identifier: Apache-2.0
#include "host/text/units.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(UnitsPrintReference, a_number_has_its_significant_digits_and_an_exponent_only_where_it_must) {
  struct Case {
    double number;
    int digits;
    std::string text;
  };
  for (const Case& c :
       std::vector<Case>{{0, 3, "0"},
                         {-0.0, 3, "0"},
                         {12.3456, 3, "12.3"},
                         {-12.3456, 4, "-12.35"},
                         {12.3, 6, "12.3"},
                         {0.00012345, 3, "0.000123"},
                         {0.0001, 3, "0.0001"},
                         {0.00099996, 3, "0.001"},
                         {9.994, 3, "9.99"},
                         {99.96, 3, "100"},
                         {999.6, 3, "1000"},
                         {0.1 + 0.2, 17, "0.30000000000000004"},
                         {100, 1, "100"},
                         {1500, 2, "1500"},
                         {1e-9, 3, "1e-09"},
                         {-1.234e-12, 3, "-1.23e-12"},
                         {1.2345e-5, 3, "1.23e-05"},
                         // Whole digits are all there up to 1e15, whatever their number.
                         {123456, 3, "123456"},
                         {-123456.7, 3, "-123457"},
                         {99950, 3, "99950"},
                         {123456789, 9, "123456789"},
                         {1e15, 3, "1e+15"},
                         {1.2345e17, 3, "1.23e+17"},
                         {2, 0, "2"},
                         {0.1, 40, "0.10000000000000001"},
                         {1. / 3, 15, "0.333333333333333"},
                         {kNan, 3, "not a number"},
                         {kInfinity, 3, "infinity"},
                         {-kInfinity, 3, "-infinity"}}) {
    EXPECT_EQ(format_number(c.number, c.digits), c.text) << c.number << " " << c.digits;
  }
  EXPECT_EQ(format_number(2.0 / 3), "0.667");
}

struct Rung {
  std::string_view symbol;
  double from;
};
struct Ladder {
  std::string_view dimension;
  std::vector<Rung> rungs;
};
// The display units, largest first, and from where each is used, SI.
const std::vector<Ladder> kLadders{
    {"m", {{"m", 1}, {"mm", 1e-3}, {"um", 1e-7}, {"nm", 0}}},
    {"s", {{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 0}}},
    {"m/s", {{"m/s", 1}, {"mm/s", 1e-4}, {"um/s", 0}}},
    {"m/s^2", {{"m/s^2", 1}, {"mm/s^2", 0}}},
    {"rad", {{"deg", 0}}},
    {"rad/s", {{"deg/s", 0}}},
    {"Hz", {{"MHz", 1e6}, {"kHz", 1e4}, {"Hz", 0}}},
    {"T", {{"T", 1}, {"mT", 1e-4}, {"uT", 0}}},
    {"T/m", {{"T/m", 1}, {"mT/m", 0}}},
    {"A", {{"A", 0.1}, {"mA", 1e-4}, {"uA", 0}}},
    {"A/m", {{"kA/m", 1e3}, {"A/m", 0}}},
    {"V", {{"V", 0.1}, {"mV", 1e-4}, {"uV", 0}}},
    {"N", {{"N", 1}, {"mN", 1e-3}, {"uN", 1e-7}, {"nN", 0}}},
    {"N m", {{"N m", 1}, {"mN m", 1e-3}, {"uN m", 1e-7}, {"nN m", 0}}},
    {"kg", {{"kg", 1}, {"g", 1e-3}, {"mg", 1e-6}, {"ug", 0}}},
    {"K", {{"degC", 200}, {"K", 0.1}, {"mK", 0}}},
    {"m^2", {{"m^2", 1}, {"mm^2", 1e-8}, {"um^2", 0}}},
    {"m^3", {{"mL", 1e-7}, {"uL", 0}}},
    {"m^3/s", {{"mL/min", 1e-9}, {"uL/min", 0}}},
    {"Pa", {{"bar", 1e5}, {"mbar", 1}, {"Pa", 0}}},
    {"W", {{"W", 1}, {"mW", 0}}},
    {"m^2/s", {{"cSt", 0}}},
    {"Pa s", {{"Pa s", 1}, {"mPa s", 0}}},
    {"1/m", {{"D", 0}}}};

TEST(UnitsPrintReference, display_units_come_largest_first_and_each_begins_where_it_says) {
  std::set<std::string_view> with_ladder;
  for (const Ladder& ladder : kLadders) {
    with_ladder.insert(ladder.dimension);
    const auto displayed = display_units(ladder.dimension);
    ASSERT_EQ(displayed.size(), ladder.rungs.size()) << ladder.dimension;
    for (std::size_t i = 0; i < displayed.size(); ++i) {
      const auto& [symbol, from] = ladder.rungs[i];
      EXPECT_EQ(displayed[i].unit.symbol, symbol);
      EXPECT_NEAR(displayed[i].from, from, 1e-15 * from) << symbol;
      if (from == 0) continue;
      EXPECT_EQ(show_quantity(from, ladder.dimension).unit, print_unit(symbol));
      const std::string below = print_unit(ladder.rungs[i + 1].symbol);
      EXPECT_EQ(show_quantity(from * 0.99, ladder.dimension).unit, below);
      // Of the size, so either sign; a temperature has its own rule below.
      if (symbol != "degC") {
        EXPECT_EQ(show_quantity(-from, ladder.dimension).unit, print_unit(symbol));
      }
      // What the digits round up to the next unit is shown in that one: no "1000 um".
      EXPECT_EQ(show_quantity(from * 0.9996, ladder.dimension).unit, print_unit(symbol));
      EXPECT_EQ(show_quantity(from * 0.9996, ladder.dimension, 4).unit, below);
    }
  }
  for (const Unit& unit : units()) {  // all others: the unit that was declared, and it alone
    if (with_ladder.contains(unit.symbol)) continue;
    const auto displayed = display_units(unit.symbol);
    ASSERT_EQ(displayed.size(), 1U) << unit.symbol;
    EXPECT_EQ(displayed[0].unit.symbol, unit.symbol);
    EXPECT_EQ(displayed[0].unit.factor, unit.factor) << unit.symbol;
    EXPECT_EQ(displayed[0].from, 0) << unit.symbol;
  }
  ASSERT_EQ(display_units("degC").size(), 1U);
  EXPECT_EQ(display_units("degC")[0].unit.offset, 273.15);
}

/// Shown as `print` for people and as `plain` for programs.
struct Printed {
  double in_si;
  std::string_view unit;
  int digits;
  std::string print, plain;
};
void expect_printed(const std::vector<Printed>& cases) {
  for (const Printed& c : cases) {
    EXPECT_EQ(format_quantity(c.in_si, c.unit, c.digits), c.print) << c.in_si << " " << c.unit;
    EXPECT_EQ(plain_quantity(c.in_si, c.unit, c.digits), c.plain) << c.in_si << " " << c.unit;
    const Shown shown = show_quantity(c.in_si, c.unit, c.digits);
    EXPECT_EQ(with_unit(shown), c.print) << c.in_si << " " << c.unit;
  }
}

TEST(UnitsPrintReference, a_quantity_is_in_the_display_unit_of_its_size_or_in_the_declared_one) {
  const double degree = std::numbers::pi / 180;
  expect_printed({{0.0123, "m", 3, "12.3 mm", "12.3 mm"},
                  {-220e-6, "m", 3, "-220 µm", "-220 um"},
                  {123.456e-6, "m", 5, "123.46 µm", "123.46 um"},
                  {0, "m", 3, "0 mm", "0 mm"},
                  {0, "T", 3, "0 mT", "0 mT"},
                  {-0.0, "s", 3, "0 s", "0 s"},
                  {0.5e-3, "m/s", 3, "0.5 mm/s", "0.5 mm/s"},
                  {30 * degree, "rad", 3, "30°", "30 deg"},
                  {-30 * degree, "deg", 3, "-30°", "-30 deg"},
                  {0.524, "mrad", 3, "524 mrad", "524 mrad"},
                  {12 * degree, "rad/s", 3, "12 °/s", "12 deg/s"},
                  {2e-9, "N m", 3, "2 nN·m", "2 nN m"},
                  {1005, "kg/m^3", 4, "1005 kg/m³", "1005 kg/m^3"},
                  {47, "ohm", 3, "47 Ω", "47 ohm"},
                  {5e-5, "m", 3, "50 µm", "50 um"},
                  {5e-5, "mm", 3, "0.05 mm", "0.05 mm"},
                  {2.5, "um", 3, "2500000 µm", "2500000 um"},
                  {0.256, "%", 3, "25.6 %", "25.6 %"},
                  {0.256, "", 3, "0.256", "0.256"},
                  {62, "min", 3, "1.03 min", "1.03 min"},
                  {0.062, "s", 3, "62 ms", "62 ms"},
                  {-12.5, "px", 3, "-12.5 px", "-12.5 px"}});
  EXPECT_EQ(format_quantity(1.0 / 3000, "m"), "333 µm");  // three digits unless it is said
  EXPECT_EQ(plain_quantity(1.0 / 3000, "m"), "333 um");
  EXPECT_EQ(show_quantity(1.0 / 3000, "m").number, "333");
}

TEST(UnitsPrintReference, a_time_of_a_minute_and_more_is_in_minutes_and_programs_get_seconds) {
  expect_printed({{60, "s", 3, "1 min 00 s", "60 s"},
                  {62, "s", 3, "1 min 02 s", "62 s"},
                  {-62.3, "s", 3, "-1 min 02 s", "-62.3 s"},
                  {61.5, "s", 3, "1 min 02 s", "61.5 s"},
                  {119.4, "s", 3, "1 min 59 s", "119 s"},
                  {754, "s", 3, "12 min 34 s", "754 s"},
                  {3599.4, "s", 3, "59 min 59 s", "3599 s"},
                  {3599.6, "s", 3, "1 h 00 min", "3600 s"},
                  {3725, "s", 3, "1 h 02 min", "3725 s"},
                  {-3725, "s", 3, "-1 h 02 min", "-3725 s"},
                  {90000, "s", 3, "25 h 00 min", "90000 s"},
                  {59.4, "s", 3, "59.4 s", "59.4 s"},
                  {3725, "h", 3, "1.03 h", "1.03 h"}});
  EXPECT_EQ(show_quantity(62, "s").unit, "");
  EXPECT_EQ(show_quantity(62, "s").number, "1 min 02 s");
}

// What is a minute in whole seconds is one.
TEST(UnitsPrintReference, a_time_is_a_minute_from_where_whole_seconds_are_one) {
  EXPECT_EQ(format_quantity(59.49, "s"), "59.5 s");
  EXPECT_EQ(format_quantity(-59.51, "s"), "-1 min 00 s");
}

TEST(UnitsPrintReference, a_temperature_is_in_celsius_and_a_difference_in_kelvin) {
  expect_printed({{300, "K", 3, "26.9 °C", "26.9 degC"},
                  {200, "K", 3, "-73.1 °C", "-73.1 degC"},
                  {199.4, "K", 3, "199 K", "199 K"},
                  {199.99, "K", 5, "199.99 K", "199.99 K"},
                  {-5, "K", 3, "-5 K", "-5 K"},
                  {0, "K", 3, "0 K", "0 K"},
                  {0.002, "K", 3, "2 mK", "2 mK"},
                  {-40, "degC", 3, "-313 °C", "-313 degC"},
                  {273.16, "degC", 5, "0.01 °C", "0.01 degC"}});
}

// Of what is smaller than 200 K, as rounded, the header says that it stays in K.
TEST(UnitsPrintReference, a_difference_stays_in_kelvin) {
  EXPECT_EQ(format_quantity(-300, "K"), "-300 K");
  EXPECT_EQ(format_quantity(-0.002, "K"), "-2 mK");
  EXPECT_EQ(format_quantity(199.4, "K"), "199 K");
  EXPECT_EQ(format_quantity(199.6, "K"), "-73.5 °C");
}

TEST(UnitsPrintReference, what_is_no_number_has_no_unit) {
  for (const std::string_view unit : {"m", "s", "K", "degC", "%", "", "rad"}) {
    for (const auto& [number, text] : std::vector<std::pair<double, std::string>>{
             {kNan, "not a number"}, {kInfinity, "infinity"}, {-kInfinity, "-infinity"}}) {
      const Shown shown = show_quantity(number, unit);
      EXPECT_EQ(shown.number, text) << unit;
      EXPECT_EQ(shown.unit, "") << unit;
      EXPECT_EQ(format_quantity(number, unit), text) << unit;
      EXPECT_EQ(plain_quantity(number, unit), text) << unit;
    }
  }
}

TEST(UnitsPrintReference, number_and_unit_are_joined_by_what_is_asked_for) {
  EXPECT_EQ(with_unit({"12", "mm"}, "\u00a0"), "12\u00a0mm");
  EXPECT_EQ(with_unit({"12", "mm"}), "12 mm");
  EXPECT_EQ(with_unit({"12", "mm"}, ""), "12mm");
  EXPECT_EQ(with_unit({"30", "°"}, "~"), "30°");
  EXPECT_EQ(with_unit({"30", "°C"}, "~"), "30~°C");
  EXPECT_EQ(with_unit({"30", "°/s"}, "~"), "30~°/s");
  EXPECT_EQ(with_unit({"1 min 02 s", ""}, "~"), "1 min 02 s");
}

TEST(UnitsPrintReference, what_is_printed_is_read_back_to_its_digits) {
  std::mt19937_64 random(20261128);
  std::uniform_real_distribution<double> exponent(-3, 3), mantissa(1, 10);
  std::vector<std::string_view> all{"degC"};
  for (const Unit& unit : units()) all.push_back(unit.symbol);
  for (const std::string_view symbol : all) {
    const Unit unit = *find_unit(symbol);
    for (const int digits : {3, 6, 12}) {
      for (int i = 0; i < 20; ++i) {
        const double sign = i % 2 == 0 ? 1 : -1;
        const double number = sign * mantissa(random) * std::pow(10, exponent(random));
        const double in_si = unit.to_si(number);
        std::vector<std::string> texts{plain_quantity(in_si, symbol, digits)};
        // Times are for people only.
        if (unit.dimension != "s") texts.push_back(format_quantity(in_si, symbol, digits));
        for (const std::string& text : texts) {
          const auto back = parse_quantity(text);
          ASSERT_TRUE(back) << text;
          EXPECT_EQ(back->dimension, unit.dimension) << text;
          // The number that was rounded is in a unit with another zero only for temperatures.
          const double largest = std::abs(in_si) + (unit.dimension == "K" ? 273.15 : 0);
          EXPECT_NEAR(back->value, in_si, largest * 0.5001 * std::pow(10, 1 - digits)) << text;
        }
      }
    }
  }
}

// The unit is in the characters of the table ("um").
TEST(UnitsPrintReference, a_declared_unit_in_print_is_plain_for_programs) {
  EXPECT_EQ(plain_quantity(220e-6, "µm"), "220 um");
  EXPECT_EQ(plain_quantity(295.15, "°C"), "22 degC");
}

TEST(UnitsPrintReference, a_unit_in_print_stays_as_it_is) {
  for (const std::string unit : {"", "%", "px", "µm", "°", "°C", "mm²/s", "Pa·s", "Ω"})
    EXPECT_EQ(print_unit(unit), unit);
  EXPECT_EQ(print_unit("degC"), "°C");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
