// SPDX-License-Identifier: Apache-2.0
#include "host/runs/comparison.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

RunData run(const std::string& name, double speed, double error, std::uint64_t seed) {
  RunData data;
  data.folder = "runs/" + name;
  data.start.protocol_title = "Servo round a <square>";
  data.start.parameters = {{"speed", speed}, {"law", "pd"}};
  data.start.parameter_units = {{"speed", "mm/s"}};
  data.start.seed = seed;
  data.end = RunEnd{Outcome::completed, "", 10, 1};
  data.results = {{"wall_time", 1, "s"}, {"path_error", error, "m"}};
  Stream servo;
  servo.info = {"servo",
                "",
                {{"x", "m"},
                 {"y", "m"},
                 {"z", "m"},
                 {"target_x", "m"},
                 {"target_y", "m"},
                 {"target_z", "m"},
                 {"never", "m"}}};
  for (int i = 0; i < 100; ++i) {
    servo.times.push_back(from_seconds(0.1 * i));
    for (const double value : {error * i, 0.0, 0.0, 0.0, 0.0, 0.0, kNaN})
      servo.values.push_back(value);
  }
  data.streams = {servo};
  return data;
}

TEST(Comparison, ShowsOnlyWhatDiffersAndSaysWhatDoesNot) {
  const RunComparison made = compare_runs({run("a", 0.5e-3, 137e-6, 1), run("b", 1e-3, 61e-6, 1)});
  ASSERT_EQ(made.differing.size(), 1U);
  EXPECT_EQ(made.differing[0].name, "speed");
  EXPECT_EQ(made.differing[0].cells, (std::vector<std::string>{"0.5 mm/s", "1 mm/s"}));
  EXPECT_NE(std::find(made.same.begin(), made.same.end(), "seed"), made.same.end());
  EXPECT_NE(std::find(made.same.begin(), made.same.end(), "law"), made.same.end());
}

TEST(Comparison, PutsEachResultInOneUnitWithTheDifferenceAndTimesLast) {
  const RunComparison made = compare_runs({run("a", 0.5e-3, 137e-6, 1), run("b", 1e-3, 61e-6, 2)});
  ASSERT_EQ(made.results.size(), 2U);
  EXPECT_EQ(made.results[0].name, "path_error (\u00b5m)");
  EXPECT_EQ(made.results[0].cells, (std::vector<std::string>{"137", "61"}));
  EXPECT_EQ(made.results[0].difference, "\u221276");
  EXPECT_EQ(made.results[1].name, "wall_time (s)");
}

TEST(Comparison, AResultThatOneRunLacksIsADashAndHasNoDifference) {
  RunData without = run("b", 1e-3, 0, 1);
  without.results.pop_back();
  const RunComparison made = compare_runs({run("a", 1e-3, 137e-6, 1), without});
  EXPECT_EQ(made.results[0].cells[1], "\u2013");
  EXPECT_EQ(made.results[0].difference, "");
}

TEST(Comparison, DifferentQuantitiesUnderOneNameKeepTheirUnitsAndHaveNoDifference) {
  RunData field = run("b", 1e-3, 0, 1);
  field.results = {{"wall_time", 1, "s"}, {"path_error", 0.012, "T"}};
  const RunComparison made = compare_runs({run("a", 1e-3, 137e-6, 1), field});
  EXPECT_EQ(made.results[0].name, "path_error");
  EXPECT_EQ(made.results[0].cells, (std::vector<std::string>{"137 \u00b5m", "12 mT"}));
  EXPECT_EQ(made.results[0].difference, "");
}

TEST(Comparison, ThePageOverlaysStreamsAndHasNeitherScriptsTextNorNan) {
  const std::string page = comparison_html(
      {run("a", 1e-3, 1e-6, 1), run("b", 2e-3, 2e-6, 2), run("<c>", 2e-3, 3e-6, 3)});
  EXPECT_NE(page.find("Distance from the target, by servo"), std::string::npos);
  EXPECT_NE(page.find("servo: x"), std::string::npos);
  EXPECT_EQ(page.find("servo: never"), std::string::npos) << "it has no data";
  EXPECT_NE(page.find("&lt;c&gt;"), std::string::npos);
  EXPECT_EQ(page.find("<c>"), std::string::npos);
  EXPECT_EQ(page.find("nan"), std::string::npos);
}

TEST(Comparison, WantsTwoToEightRuns) {
  EXPECT_THROW(compare_runs({run("a", 1, 1, 1)}), std::invalid_argument);
  EXPECT_THROW(compare_runs(std::vector<RunData>(9, run("a", 1, 1, 1))), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
