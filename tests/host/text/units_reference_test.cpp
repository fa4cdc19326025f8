// Units and the reading of quantities against a table of the SI's own definitions.
// SPDX-License-Identifier: Apache-2.0
#include "host/text/units.h"

#include <gtest/gtest.h>

#include <cmath>
#include <locale>
#include <numbers>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

// Definitions: BIPM, The International System of Units, 9th edition, tables 4, 7 and 8; 1 bar and
// 1 St by the CGS.
constexpr double kMilli = 1. / 1000, kMicro = kMilli / 1000, kNano = kMicro / 1000;
constexpr double kMinute = 60, kHour = 60 * kMinute, kDegree = std::numbers::pi / 180;
constexpr double kCentimeter = 1. / 100, kLiter = 1. / (10. * 10. * 10.), kBar = 100000;

struct Row {
  std::string_view symbol, dimension;
  double factor;
  std::string_view quantity, lua, print;
};
// In the order of docs/reference/api.md, and those without a name in Lua among them.
const std::vector<Row> kRows{
    {"m", "m", 1, "a length", "m", "m"},
    {"cm", "m", kCentimeter, "a length", "cm", "cm"},
    {"mm", "m", kMilli, "a length", "mm", "mm"},
    {"um", "m", kMicro, "a length", "um", "µm"},
    {"nm", "m", kNano, "a length", "nm", "nm"},
    {"s", "s", 1, "a time", "s", "s"},
    {"ms", "s", kMilli, "a time", "ms", "ms"},
    {"us", "s", kMicro, "a time", "us", "µs"},
    {"ns", "s", kNano, "a time", "ns", "ns"},
    {"min", "s", kMinute, "a time", "min", "min"},
    {"h", "s", kHour, "a time", "h", "h"},
    {"m/s", "m/s", 1, "a speed", "m_per_s", "m/s"},
    {"cm/s", "m/s", kCentimeter, "a speed", "cm_per_s", "cm/s"},
    {"mm/s", "m/s", kMilli, "a speed", "mm_per_s", "mm/s"},
    {"um/s", "m/s", kMicro, "a speed", "um_per_s", "µm/s"},
    {"m/s^2", "m/s^2", 1, "an acceleration", "m_per_s2", "m/s²"},
    {"mm/s^2", "m/s^2", kMilli, "an acceleration", "mm_per_s2", "mm/s²"},
    {"rad", "rad", 1, "an angle", "rad", "rad"},
    {"mrad", "rad", kMilli, "an angle", "mrad", "mrad"},
    {"deg", "rad", kDegree, "an angle", "deg", "°"},
    {"arcmin", "rad", kDegree / 60, "an angle", "arcmin", "arcmin"},
    {"rad/s", "rad/s", 1, "an angular speed", "rad_per_s", "rad/s"},
    {"deg/s", "rad/s", kDegree, "an angular speed", "deg_per_s", "°/s"},
    {"Hz", "Hz", 1, "a frequency", "Hz", "Hz"},
    {"kHz", "Hz", 1 / kMilli, "a frequency", "kHz", "kHz"},
    {"MHz", "Hz", 1 / kMicro, "a frequency", "MHz", "MHz"},
    {"1/s", "Hz", 1, "a frequency", "", "1/s"},
    {"1/s^2", "1/s^2", 1, "a gain", "", "1/s²"},
    {"T", "T", 1, "a magnetic field", "T", "T"},
    {"mT", "T", kMilli, "a magnetic field", "mT", "mT"},
    {"uT", "T", kMicro, "a magnetic field", "uT", "µT"},
    {"T/m", "T/m", 1, "a field gradient", "T_per_m", "T/m"},
    {"mT/m", "T/m", kMilli, "a field gradient", "mT_per_m", "mT/m"},
    {"A", "A", 1, "a current", "A", "A"},
    {"mA", "A", kMilli, "a current", "mA", "mA"},
    {"uA", "A", kMicro, "a current", "uA", "µA"},
    {"A/s", "A/s", 1, "a rate of current", "A_per_s", "A/s"},
    {"A/m", "A/m", 1, "a magnetization", "A_per_m", "A/m"},
    {"kA/m", "A/m", 1 / kMilli, "a magnetization", "kA_per_m", "kA/m"},
    {"V", "V", 1, "a voltage", "V", "V"},
    {"mV", "V", kMilli, "a voltage", "mV", "mV"},
    {"uV", "V", kMicro, "a voltage", "uV", "µV"},
    {"ohm", "ohm", 1, "a resistance", "ohm", "Ω"},
    {"N", "N", 1, "a force", "N", "N"},
    {"mN", "N", kMilli, "a force", "mN", "mN"},
    {"uN", "N", kMicro, "a force", "uN", "µN"},
    {"nN", "N", kNano, "a force", "nN", "nN"},
    {"N m", "N m", 1, "a torque", "N_m", "N·m"},
    {"mN m", "N m", kMilli, "a torque", "mN_m", "mN·m"},
    {"uN m", "N m", kMicro, "a torque", "uN_m", "µN·m"},
    {"nN m", "N m", kNano, "a torque", "nN_m", "nN·m"},
    {"N/m", "N/m", 1, "a stiffness", "N_per_m", "N/m"},
    {"N s/m", "N s/m", 1, "a drag coefficient", "N_s_per_m", "N·s/m"},
    {"A m^2", "A m^2", 1, "a magnetic moment", "A_m2", "A·m²"},
    {"kg", "kg", 1, "a mass", "kg", "kg"},
    {"g", "kg", kMilli, "a mass", "g", "g"},
    {"mg", "kg", kMicro, "a mass", "mg", "mg"},
    {"ug", "kg", kNano, "a mass", "ug", "µg"},
    {"K", "K", 1, "a temperature", "K", "K"},
    {"mK", "K", kMilli, "a temperature", "mK", "mK"},
    {"m^2", "m^2", 1, "an area", "m2", "m²"},
    {"mm^2", "m^2", kMilli* kMilli, "an area", "mm2", "mm²"},
    {"um^2", "m^2", kMicro* kMicro, "an area", "um2", "µm²"},
    {"m^3", "m^3", 1, "a volume", "m3", "m³"},
    {"L", "m^3", kLiter, "a volume", "L", "L"},
    {"mL", "m^3", kMilli* kLiter, "a volume", "mL", "mL"},
    {"uL", "m^3", kMicro* kLiter, "a volume", "uL", "µL"},
    {"m^3/s", "m^3/s", 1, "a flow", "m3_per_s", "m³/s"},
    {"mL/min", "m^3/s", kMilli* kLiter / kMinute, "a flow", "mL_per_min", "mL/min"},
    {"uL/min", "m^3/s", kMicro* kLiter / kMinute, "a flow", "uL_per_min", "µL/min"},
    {"mL/h", "m^3/s", kMilli* kLiter / kHour, "a flow", "mL_per_h", "mL/h"},
    {"uL/h", "m^3/s", kMicro* kLiter / kHour, "a flow", "uL_per_h", "µL/h"},
    {"Pa", "Pa", 1, "a pressure", "Pa", "Pa"},
    {"kPa", "Pa", 1 / kMilli, "a pressure", "kPa", "kPa"},
    {"mbar", "Pa", kMilli* kBar, "a pressure", "mbar", "mbar"},
    {"bar", "Pa", kBar, "a pressure", "bar", "bar"},
    {"W", "W", 1, "a power", "W", "W"},
    {"mW", "W", kMilli, "a power", "mW", "mW"},
    {"m^2/s", "m^2/s", 1, "a kinematic viscosity", "m2_per_s", "m²/s"},
    {"mm^2/s", "m^2/s", kMilli* kMilli, "a kinematic viscosity", "mm2_per_s", "mm²/s"},
    {"cSt", "m^2/s", kCentimeter* kCentimeter / 100, "a kinematic viscosity", "cSt", "cSt"},
    {"Pa s", "Pa s", 1, "a viscosity", "Pa_s", "Pa·s"},
    {"mPa s", "Pa s", kMilli, "a viscosity", "mPa_s", "mPa·s"},
    {"kg/m^3", "kg/m^3", 1, "a density", "kg_per_m3", "kg/m³"},
    {"g/cm^3", "kg/m^3", kMilli / (kCentimeter * kCentimeter * kCentimeter), "a density",
     "g_per_cm3", "g/cm³"},
    {"D", "1/m", 1, "an optical power", "D", "D"},
    {"1/m", "1/m", 1, "a spatial frequency", "", "1/m"},
    {"%", "", 1. / 100, "a plain number", "", "%"}};

void expect_equal(double value, double expected, std::string_view what) {
  EXPECT_NEAR(value, expected, 1e-15 * std::abs(expected)) << what;
}

TEST(UnitsReference, each_unit_is_that_of_the_si) {
  ASSERT_EQ(units().size(), kRows.size());
  for (std::size_t i = 0; i < kRows.size(); ++i) {
    const Row& row = kRows[i];
    const Unit& unit = units()[i];
    EXPECT_EQ(unit.symbol, row.symbol);
    EXPECT_EQ(unit.dimension, row.dimension) << row.symbol;
    EXPECT_EQ(unit.quantity, row.quantity) << row.symbol;
    expect_equal(unit.factor, row.factor, row.symbol);
    EXPECT_EQ(unit.offset, 0) << row.symbol;
    expect_equal(unit.to_si(-3.7), -3.7 * row.factor, row.symbol);
    expect_equal(unit.from_si(-3.7), -3.7 / row.factor, row.symbol);
    EXPECT_EQ(unit_name(row.symbol), row.lua);
    EXPECT_EQ(print_unit(row.symbol), row.print);
    EXPECT_EQ(si_unit(row.symbol), row.dimension);
    EXPECT_EQ(si_unit(row.print), row.dimension);
  }
}

TEST(UnitsReference, each_unit_is_found_by_its_symbol_and_by_its_print) {
  for (const Row& row : kRows) {
    for (const std::string_view spelling : {row.symbol, row.print}) {
      const auto unit = find_unit(spelling);
      ASSERT_TRUE(unit) << spelling;
      EXPECT_EQ(unit->symbol, row.symbol);
      EXPECT_EQ(unit->dimension, row.dimension);
      EXPECT_EQ(unit->quantity, row.quantity);
      expect_equal(unit->factor, row.factor, spelling);
    }
  }
  EXPECT_EQ(find_unit("\u03bcm")->symbol, "um");  // the Greek letter, beside the micro sign
  const auto plain = find_unit("");
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->symbol, "");
  EXPECT_EQ(plain->dimension, "");
  EXPECT_EQ(plain->to_si(-2.5), -2.5);
  for (const std::string_view none : {"px", "bogus", "MM", " mm", "mm ", "m m", "mm^3", "mm³", "1",
                                      "mmm", "Mm", "mm/", "/s", "k", "µ", "C", "deg C"}) {
    EXPECT_FALSE(find_unit(none)) << none;
    EXPECT_EQ(si_unit(none), none);
    EXPECT_TRUE(display_units(none).empty()) << none;
  }
}

TEST(UnitsReference, a_celsius_temperature_has_its_zero_and_is_not_among_the_units) {
  for (const std::string_view spelling : {"degC", "°C"}) {
    const auto unit = find_unit(spelling);
    ASSERT_TRUE(unit);
    EXPECT_EQ(unit->symbol, "degC");
    EXPECT_EQ(unit->dimension, "K");
    EXPECT_EQ(unit->quantity, "a temperature");
    EXPECT_EQ(unit->factor, 1);
    EXPECT_EQ(unit->offset, 273.15);
    EXPECT_NEAR(unit->to_si(-40.5), 232.65, 1e-13);
    EXPECT_NEAR(unit->from_si(310.25), 37.1, 1e-13);
    EXPECT_EQ(si_unit(spelling), "K");
    EXPECT_EQ(print_unit(spelling), "°C");
  }
  for (const Unit& unit : units()) EXPECT_NE(unit.symbol, "degC");
  const Unit both{"x", "y", 2.5, "z", -7};
  EXPECT_EQ(both.to_si(3), 0.5);
  EXPECT_EQ(both.from_si(0.5), 3);
}

TEST(UnitsReference, a_dimension_has_the_name_of_what_it_measures) {
  std::set<std::string_view> told;
  for (const Row& row : kRows) {
    if (!told.insert(row.dimension).second) continue;
    EXPECT_EQ(quantity_name(row.dimension), row.quantity);
  }
  for (const std::string_view none : {"um", "min", "%", "degC", "bogus", "px", "kg m"})
    EXPECT_EQ(quantity_name(none), none);
}

/// Whether `text` is the number, to rounding, and of that dimension.
void expect_parsed(const std::string& text, double value, std::string_view dimension, bool bare) {
  const auto quantity = parse_quantity(text);
  ASSERT_TRUE(quantity) << text;
  EXPECT_NEAR(quantity->value, value, 1e-15 * std::abs(value)) << text;
  EXPECT_EQ(quantity->dimension, dimension) << text;
  EXPECT_EQ(quantity->bare, bare) << text;
}

TEST(UnitsReference, quantities_are_read_with_every_unit_however_it_is_spelled) {
  for (const Row& row : kRows) {
    for (const std::string_view unit : {row.symbol, row.print}) {
      for (const std::string_view space : {"", " ", "  ", "\t"}) {
        const std::string text = "-12.75" + std::string(space) + std::string(unit);
        // A digit of the unit that follows at once belongs to the number.
        if (space.empty() && unit.front() == '1') continue;
        expect_parsed(text, -12.75 * row.factor, row.dimension, false);
      }
    }
  }
  expect_parsed("-40.5 degC", 232.65, "K", false);
  expect_parsed("21.5°C", 294.65, "K", false);
}

TEST(UnitsReference, numbers_are_read_in_every_form_of_theirs) {
  expect_parsed("-3", -3, "", true);
  expect_parsed("+3", 3, "", true);
  expect_parsed("-.5", -0.5, "", true);
  expect_parsed("5.mm", 5e-3, "m", false);
  expect_parsed("1.5e+2mm", 0.15, "m", false);
  expect_parsed("3E-2 um", 3e-8, "m", false);
  expect_parsed("  00012 mm \n", 12e-3, "m", false);
  expect_parsed("1e-300", 1e-300, "", true);
  expect_parsed("1.7976931348623157e308", 1.7976931348623157e308, "", true);
}

TEST(UnitsReference, what_is_no_quantity_is_nothing) {
  for (const std::string text :
       {"",           " ",      "mm",     "nan",     "inf",    "-inf",     "infinity",
        "nan mm",     "inf mm", "NaN",    "1e999",   "-1e999", "1e999 mm", "1e308 h",
        "-1e308 kHz", "0x10",   "1,5 mm", "1.5.2mm", "3 mmm",  "3 m m",    "1e",
        "1e mm",      "--3",    "+-3",    "-+3",     "- 3",    "+",        "-",
        ".",          ". mm",   "e5",     "1_0",     "5 mm 2", "5 mm mm",  "3 Mm",
        "3 mHz",      "12 px",  "12 1",   "3 MM",    "mm 3",   "3' mm"}) {
    EXPECT_FALSE(parse_quantity(text)) << text;
  }
  EXPECT_FALSE(parse_quantity(std::string("3\0mm", 4)));
}

TEST(UnitsReference, what_is_read_does_not_depend_on_the_programs_locale) {
  struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  const std::locale before = std::locale::global(std::locale(std::locale(), new Comma));
  expect_parsed("1234.5mm", 1.2345, "m", false);
  EXPECT_FALSE(parse_quantity("1,5 mm"));
  EXPECT_FALSE(parse_quantity("1.234,5 mm"));
  std::locale::global(before);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
