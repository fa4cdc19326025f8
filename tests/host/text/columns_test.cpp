// SPDX-License-Identifier: Apache-2.0
#include "host/text/columns.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Texts = std::vector<std::string>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(Columns, OneUnitAndTheSameDecimals) {
  const ShownColumn lengths = show_column({1.234e-3, 980e-6, 0}, "m");
  EXPECT_EQ(lengths.numbers, (Texts{"1.23", "0.98", "0.00"}));
  EXPECT_EQ(lengths.unit, "mm");
  EXPECT_EQ(show_column({1e-3, 2.5e-3, 1}, "m").numbers, (Texts{"1.0", "2.5", "1000.0"}));
  EXPECT_EQ(show_column({2e-3, 4e-3}, "m").numbers, (Texts{"2", "4"})) << "no zeros for show";
  EXPECT_EQ(show_column({}, "m").unit, "mm");
  EXPECT_EQ(show_column({0, -1e-18}, "m").numbers, (Texts{"0", "0"}));
}

TEST(Columns, TheSmallestValueIsStillRead) {
  const ShownColumn wide = show_column({5.2e-3, 3.04e-6}, "m");
  EXPECT_EQ(wide.unit, "\u00b5m");
  EXPECT_EQ(wide.numbers, (Texts{"5200", "3"}));
  EXPECT_EQ(show_column({1, 1e-6}, "m").unit, "mm") << "a million micrometers are not read";
}

TEST(Columns, TimesDoNotBecomeMinutesAndSeconds) {
  EXPECT_EQ(show_column({4.53, 62, 125}, "s").numbers, (Texts{"4.5", "62.0", "125.0"}));
  EXPECT_EQ(show_column({3600, 43200}, "s").unit, "h");
}

TEST(Columns, ARangeHasItsUnitOnce) {
  EXPECT_EQ(format_range(0.5, 60, "s"), "0.5 to 60 s");
  EXPECT_EQ(format_range(0, 2e-3, "m"), "0 to 2 mm");
  EXPECT_EQ(format_range(1e-6, 10e-3, "m"), "1 \u00b5m to 10 mm");
}

TEST(Columns, OtherUnits) {
  EXPECT_EQ(show_column({310.15, 353.15}, "K").numbers, (Texts{"37", "80"}));
  EXPECT_EQ(show_column({310.15, 353.15}, "K").unit, "\u00b0C");
  EXPECT_EQ(show_column({310.15, 0.5}, "K").unit, "K") << "a difference is no temperature";
  EXPECT_EQ(show_column({0.5, 0.125}, "%").numbers, (Texts{"50.0", "12.5"}));
  EXPECT_EQ(show_column({0.5, 12}, "").numbers, (Texts{"0.5", "12.0"}));
  EXPECT_EQ(show_column({1, 2}, "furlong").unit, "furlong");
  EXPECT_EQ(show_column({1e-3, kNan}, "m").numbers, (Texts{"1", "not a number"}));
}

TEST(Columns, TheUncertaintyGivesTheDigits) {
  EXPECT_EQ(format_measured(12.34e-6, 0.42e-6, "m"), "12.34 \u00b1 0.42 \u00b5m");
  EXPECT_EQ(format_measured(12.3e-3, 0.4e-6, "m"), "12.30000 \u00b1 0.00040 mm");
  EXPECT_EQ(format_measured(0, 12e-6, "m"), "0 \u00b1 12 \u00b5m");
  EXPECT_EQ(format_measured(1234, 123.4, ""), "1230 \u00b1 120");
  EXPECT_EQ(format_measured(1, 0.0996, ""), "1.00 \u00b1 0.10") << "two digits after rounding";
  EXPECT_EQ(format_measured(310.15, 1.2, "K"), "37.0 \u00b1 1.2 \u00b0C");
  EXPECT_EQ(format_measured(0.523598775598, 0.0174532925, "rad"), "30.0 \u00b1 1.0\u00b0");
  EXPECT_EQ(format_measured(1e-3, 0, "m"), "1 mm");
  EXPECT_EQ(format_measured(1e-3, kNan, "m"), "1 mm");
}

TEST(Columns, ListsShareAUnitAndJoinUncertainties) {
  const auto joined = join_uncertainties({{"depth", 1.5e-3, "m"},
                                          {"frames", 30, ""},
                                          {"depth_sigma", 12e-6, "m"},
                                          {"axis_sigma", 0.1, "rad"},
                                          {"error", 20e-6, "m"}});
  ASSERT_EQ(joined.size(), 4u) << "a sigma of nothing stays";
  const auto shown = show_list(joined);
  EXPECT_EQ(with_unit(shown[0]), "1500 \u00b1 12 \u00b5m");
  EXPECT_EQ(with_unit(shown[1]), "30");
  EXPECT_EQ(with_unit(shown[2]), "5.73\u00b0");
  EXPECT_EQ(with_unit(shown[3]), "20 \u00b5m");
  EXPECT_EQ(with_unit(show_list({{"time", 62, "s"}})[0]), "1 min 02 s") << "alone";
}

TEST(Columns, CellsOfATableComeInOneUnit) {
  EXPECT_EQ(cells_in_one_unit({"980 um", "1.23 mm", "", "0 mm", "-"}),
            (Texts{"0.980 mm", "1.23 mm", "", "0 mm", "-"}));
  EXPECT_EQ(cells_in_one_unit({"4.06 mm", "\u22120.14 \u00b5m", "3\u00b0"}),
            (Texts{"4060 \u00b5m", "-0.14 \u00b5m", "3\u00b0"}));
  EXPECT_EQ(cells_in_one_unit({"30 um/s to 0.25 mm/s", "\u00b1 2 mm/s", "at most 53 um/s", "none"}),
            (Texts{"30 \u00b5m/s to 250 \u00b5m/s", "\u00b1 2000 \u00b5m/s", "at most 53 \u00b5m/s",
                   "none"}));
  EXPECT_EQ(cells_in_one_unit({"59.4 s", "1 min 02 s", "2 h 01 min"}),
            (Texts{"0.990 min", "1.0 min", "121 min"}));
  EXPECT_EQ(cells_in_one_unit({"1.20 mm", "3 mm", "7", "12 of 30"}),
            (Texts{"1.20 mm", "3 mm", "7", "12 of 30"}))
      << "nothing to do";
}

TEST(Columns, CellsOfVeryDifferentSizesKeepTheirUnits) {
  const std::vector<std::string> cells{"14.01 µm to 14.59 µm", "0.17 m to 100 m"};
  EXPECT_EQ(cells_in_one_unit(cells), cells);
}

TEST(Columns, TheScriptsOwnUnitsAreSetInPrint) {
  EXPECT_EQ(with_print_units("137 um, at 3.5 um/s; 30 deg"),
            "137 \u00b5m, at 3.5 \u00b5m/s; 30\u00b0");
  EXPECT_EQ(with_print_units("error (um)"), "error (\u00b5m)");
  EXPECT_EQ(with_print_units("error, um"), "error, \u00b5m");
  EXPECT_EQ(with_print_units("70 degC"), "70 \u00b0C");
  for (const char* text : {"umbra 5 umbra", "of us, us too", "um", "", "5 mm (x) 3", "a,b"})
    EXPECT_EQ(with_print_units(text), text);
}

nlohmann::json table_of_quantities() {
  nlohmann::json cases = nlohmann::json::array();
  const std::vector<double> numbers{0,       1,         -3.25, 0.125, 42,    999.9,  0.9994,
                                    0.99951, 1e-3,      -1e-7, 62.5,  3725,  310.15, 1.5e-5,
                                    2.5e-4,  1234567.8, 1e12,  3e-9,  59.96, 0.15,   2.5e-18};
  for (const char* unit : {"m", "m/s", "s", "T", "A", "rad", "K", "Hz", "%", ""}) {
    for (const double value : numbers) {
      for (const int digits : {1, 2, 3, 6})
        cases.push_back({{"value", value},
                         {"unit", unit},
                         {"digits", digits},
                         {"quantity", format_quantity(value, unit, digits)},
                         {"number", format_number(value, digits)}});
      for (const double sigma : {0.42e-6, 0.0996, 1.25, 123.4})
        cases.push_back({{"value", value},
                         {"unit", unit},
                         {"sigma", sigma},
                         {"measured", format_measured(value, sigma, unit)}});
    }
    for (std::size_t i = 0; i + 3 <= numbers.size(); ++i) {
      const std::vector<double> values(numbers.begin() + static_cast<std::ptrdiff_t>(i),
                                       numbers.begin() + static_cast<std::ptrdiff_t>(i) + 3);
      const ShownColumn column = show_column(values, unit);
      cases.push_back({{"values", values},
                       {"unit", unit},
                       {"column", {{"numbers", column.numbers}, {"unit", column.unit}}}});
    }
  }
  return cases;
}

/// The page's twin (host/view/page/src/format.js) on the same values.
TEST(Columns, ThePageFormatsAlike) {
  if (std::system("node --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "there is no node";
  namespace fs = std::filesystem;
  const fs::path folder =
      fs::temp_directory_path() / ("vitreo_columns_" + std::to_string(getpid()));
  fs::create_directories(folder);
  std::ofstream(folder / "table.json") << table_of_quantities();
  fs::copy_file(fs::path(__FILE__).parent_path() / "../../../host/view/page/src/format.js",
                folder / "format.mjs");
  std::ofstream(folder / "compare.mjs") << R"(
import { readFileSync } from 'node:fs';
import { formatMeasured, formatNumber, formatQuantity, showColumn } from './format.mjs';
let wrong = 0;
const same = (row, ours, theirs) => {
  if (JSON.stringify(ours) === JSON.stringify(theirs)) return;
  ++wrong;
  console.log(JSON.stringify(row), 'the page has', JSON.stringify(ours));
};
for (const row of JSON.parse(readFileSync(new URL('table.json', import.meta.url)))) {
  if (row.column) {
    const { numbers, unit } = showColumn(row.values, row.unit);
    same(row, { numbers, unit }, row.column);
  } else if (row.measured) same(row, formatMeasured(row.value, row.sigma, row.unit), row.measured);
  else {
    same(row, formatQuantity(row.value, row.unit, row.digits), row.quantity);
    same(row, formatNumber(row.value, row.digits), row.number);
  }
}
process.exit(wrong === 0 ? 0 : 1);
)";
  EXPECT_EQ(std::system(("node '" + (folder / "compare.mjs").string() + "'").c_str()), 0);
  fs::remove_all(folder);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
