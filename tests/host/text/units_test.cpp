// SPDX-License-Identifier: Apache-2.0
#include "host/text/units.h"

#include <gtest/gtest.h>

#include <clocale>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

namespace vitreo {
namespace VITREO_TEST_FILE {

TEST(Units, EverySymbolIsThereOnce) {
  std::set<std::string_view> seen;
  for (const Unit& unit : units()) EXPECT_TRUE(seen.insert(unit.symbol).second) << unit.symbol;
}

TEST(Units, EveryUnitIsReadBackAsItIsWritten) {
  for (const Unit& unit : units()) {
    for (const char* gap : {"", " ", "*"}) {
      if (*gap == 0 && unit.symbol.starts_with('1')) continue;  // "2.51/s" is 2.51 of something
      const auto quantity = parse_quantity("2.5" + std::string(gap) + std::string(unit.symbol));
      ASSERT_TRUE(quantity) << unit.symbol;
      EXPECT_DOUBLE_EQ(quantity->value, 2.5 * unit.factor) << unit.symbol;
      EXPECT_EQ(quantity->dimension, unit.dimension);
      EXPECT_FALSE(quantity->bare);
    }
  }
}

TEST(Units, EveryUnitIsFoundAsItIsPrinted) {
  for (const Unit& unit : units()) {
    const auto found = find_unit(print_unit(unit.symbol));
    ASSERT_TRUE(found) << unit.symbol;
    EXPECT_EQ(found->symbol, unit.symbol);
  }
}

TEST(Units, WhatIsFormattedParsesToTheSameValue) {
  for (const Unit& unit : units()) {
    for (double number : {1.0, -3.25, 0.125, 42.0}) {
      const double value = number * unit.factor;
      if (unit.dimension == "s" && std::fabs(value) >= 59)
        continue;  // shown as minutes, which have no single unit
      const std::string text = format_quantity(value, unit.dimension, 9);
      const auto quantity = parse_quantity(text);
      ASSERT_TRUE(quantity) << text;
      EXPECT_NEAR(quantity->value, value, std::fabs(value) * 1e-8)
          << text;  // nine digits were asked for
    }
  }
}

TEST(Units, PlainNumbersAreBare) {
  for (const char* text : {"-3", "+3", "0.5", ".5", "1e-3", " 7 "}) {
    const auto quantity = parse_quantity(text);
    ASSERT_TRUE(quantity) << text;
    EXPECT_TRUE(quantity->bare);
    EXPECT_EQ(quantity->dimension, "");
  }
  EXPECT_EQ(parse_quantity("-3")->value, -3);
}

TEST(Units, WhatIsNoQuantityIsRefused) {
  for (const char* text :
       {"",     " ",     "mm",    "nan", "inf", "-inf", "NaN mm", "5 parsec", "5e",
        "0x10", "1,5mm", "1 000", "--3", "+-3", "3mm/", "1e400",  "1e999m",   "5 m m",
        "5*",   "5MM",   "3;s",   "-",   "+",   ".",    "1e308h"}) {
    EXPECT_FALSE(parse_quantity(text)) << text;
  }
  EXPECT_FALSE(parse_quantity(std::string_view("5\0mm", 4)));
}

TEST(Units, TheCommaOfALocaleDoesNotMatter) {
  const char* before = std::setlocale(LC_NUMERIC, nullptr);
  const std::string saved = before ? before : "C";
  std::setlocale(LC_NUMERIC, "de_DE.UTF-8");  // where it is not installed this test shows nothing
  EXPECT_EQ(parse_quantity("1.5mm")->value, 1.5e-3);
  EXPECT_EQ(format_quantity(1.5e-3, "m"), "1.5 mm");
  std::setlocale(LC_NUMERIC, saved.c_str());
}

TEST(Units, PeopleAreShownTheirUnits) {
  EXPECT_EQ(format_quantity(0.0123, "m"), "12.3 mm");
  EXPECT_EQ(format_quantity(-1.7e-18, "m"), "0 nm") << "what is left of a subtraction";
  EXPECT_EQ(format_quantity(220e-6, "m"), "220 \u00b5m");
  EXPECT_EQ(format_quantity(0.01, "T"), "10 mT");
  EXPECT_EQ(format_quantity(0.5e-3, "m/s"), "0.5 mm/s");
  EXPECT_EQ(format_quantity(50e-6, "m/s"), "50 \u00b5m/s");
  EXPECT_EQ(format_quantity(30 * std::numbers::pi / 180, "rad"), "30\u00b0");
  EXPECT_EQ(format_quantity(1e-3, "m^2/s"), "1000 cSt");
  EXPECT_EQ(format_quantity(62, "s"), "1 min 02 s");
  EXPECT_EQ(format_quantity(59.96, "s"), "1 min 00 s");
  EXPECT_EQ(format_quantity(3725, "s"), "1 h 02 min");
  EXPECT_EQ(format_quantity(-2.5, "A"), "-2.5 A");
  EXPECT_EQ(format_quantity(0, "m"), "0 mm");
  EXPECT_EQ(format_quantity(0, "s"), "0 s");
  EXPECT_EQ(format_quantity(12, ""), "12");
  EXPECT_EQ(format_quantity(3, "furlong"), "3 furlong");
  EXPECT_EQ(plain_quantity(220e-6, "m"), "220 um") << "to type back";
  EXPECT_EQ(plain_quantity(30 * std::numbers::pi / 180, "rad"), "30 deg");
  EXPECT_EQ(plain_quantity(62, "s"), "62 s");
}

TEST(Units, ADeclaredUnitIsKept) {
  EXPECT_EQ(format_quantity(0.125, "%"), "12.5 %");
  EXPECT_EQ(format_quantity(5e-3, "um"), "5000 \u00b5m");
  EXPECT_EQ(plain_quantity(0.125, "%"), "12.5 %");
  EXPECT_EQ(si_unit("%"), "");
  EXPECT_EQ(si_unit("um"), "m");
  EXPECT_EQ(si_unit("apples"), "apples");
  EXPECT_EQ(parse_quantity("12.5 %")->value, 0.125);
}

TEST(Units, TemperaturesAreInDegreesCelsius) {
  for (const char* text : {"37 degC", "37\u00b0C", "37 \u00b0C", "37 \u2103", "310.15 K"}) {
    const auto quantity = parse_quantity(text);
    ASSERT_TRUE(quantity) << text;
    EXPECT_DOUBLE_EQ(quantity->value, 310.15) << text;
    EXPECT_EQ(quantity->dimension, "K");
  }
  EXPECT_EQ(parse_quantity("-5 degC")->value, 268.15);
  EXPECT_EQ(format_quantity(310.15, "K"), "37 \u00b0C");
  EXPECT_EQ(plain_quantity(310.15, "K"), "37 degC");
  EXPECT_EQ(format_quantity(273.15, "degC"), "0 \u00b0C");
  EXPECT_EQ(format_quantity(1.5, "K"), "1.5 K") << "a difference";
  EXPECT_EQ(print_unit("degC"), "\u00b0C");
}

TEST(Units, RoundingPicksTheUnitAfterwards) {
  EXPECT_EQ(format_quantity(999.9e-6, "m"), "1 mm");
  EXPECT_EQ(format_quantity(0.0009994, "m"), "999 \u00b5m");
  EXPECT_EQ(format_quantity(1e-3, "m"), "1 mm");
}

TEST(Units, NumbersAreNeverMadeUp) {
  EXPECT_EQ(format_number(12345), "12345");
  EXPECT_EQ(format_number(0.1 + 0.2), "0.3");
  EXPECT_EQ(format_number(-0.0), "0");
  EXPECT_EQ(format_number(1e12), "1e+12");
  EXPECT_EQ(format_quantity(std::numeric_limits<double>::quiet_NaN(), "m"), "not a number");
  EXPECT_EQ(format_quantity(-std::numeric_limits<double>::infinity(), "m"), "-infinity");
}

TEST(Units, QuantitiesHaveNamesForErrors) {
  EXPECT_EQ(quantity_name("m/s"), "a speed");
  EXPECT_EQ(quantity_name(""), "a plain number");
  EXPECT_EQ(quantity_name("furlong"), "furlong");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
