// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_table.h"

#include "host/files/sqlite.h"
#include "host/trials/sweep_groups.h"
#include "host/trials/sweep_report.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;
using nlohmann::json;

/// Two speeds, two laws, three repeats; a vector with one component that moves.
PointPlan plan_of_twelve() {
  json head = {{"kind", "sweep"},
               {"protocol", {{"name", "experiment"}, {"title", "An <experiment>"}}},
               {"rig", {{"name", "bench"}}},
               {"repeats", 3},
               {"seeds", "fresh"}};
  head["axes"] = json::array();
  head["axes"].push_back({{"name", "speed"},
                          {"unit", "m/s"},
                          {"kind", "number"},
                          {"varied", true},
                          {"values", {1e-4, 2e-3}}});
  head["axes"].push_back({{"name", "law"},
                          {"unit", ""},
                          {"kind", "choice"},
                          {"varied", true},
                          {"values", {"pd", "estimator"}}});
  head["axes"].push_back({{"name", "field"},
                          {"unit", "T"},
                          {"kind", "number"},
                          {"varied", false},
                          {"values", {0.01}}});
  PointPlan plan{head, {}};
  for (const double speed : {1e-4, 2e-3})
    for (const char* law : {"pd", "estimator"})
      for (int repeat = 1; repeat <= 3; ++repeat) {
        const json what = {{"setting", 0},
                           {"repeat", repeat},
                           {"seed", 18446744073709551615ULL - plan.points.size()},
                           {"values", {{"speed", speed}, {"law", law}, {"field", 0.01}}}};
        plan.points.push_back({point_key(what), what});
      }
  return plan;
}

json result_of(std::size_t point) {
  if (point == 4) return {{"outcome", "failed"}, {"exit_code", 1}, {"reason", "lost, \"again\""}};
  return {{"outcome", "completed"},
          {"exit_code", 0},
          {"reason", ""},
          {"run", "run_" + std::to_string(point * 7919 % 31)},
          {"wall_time", 0.1 * static_cast<double>(point)},
          {"results",
           {{{"name", "error"},
             {"value", 1e-6 * (1.0 + static_cast<double>(point)) / 3},
             {"unit", "m"}},
            {{"name", "speed"}, {"value", nullptr}, {"unit", "m/s"}},
            {{"name", "wall_time"}, {"value", std::rand()}, {"unit", "s"}}}}};
}

class SweepTableTest : public testing::Test {
 protected:
  SweepTableTest() {
    std::string name = (fs::temp_directory_path() / "vitreo_table_XXXXXX").string();
    place_ = mkdtemp(name.data());
  }
  ~SweepTableTest() override { fs::remove_all(place_); }
  SweepTable table(const std::string& name, bool backwards) const {
    const PointFolder folder = PointFolder::create(place_ / name, plan_of_twelve());
    for (std::size_t i = 0; i < 12; ++i) {
      const std::size_t point = backwards ? 11 - i : i;
      folder.mark(point, result_of(point));
    }
    return read_table(folder);
  }
  fs::path place_;
};

TEST_F(SweepTableTest, HasTheSameBytesInWhateverOrderThePointsWereDone) {
  const SweepTable forward = table("forward", false);
  const SweepTable backward = table("backward", true);
  EXPECT_EQ(csv_of(forward), csv_of(backward));
  const json head = plan_of_twelve().head;
  EXPECT_EQ(sqlite_of(forward, head), sqlite_of(backward, head));
}

TEST_F(SweepTableTest, HasUnitsInItsHeaderAndEveryDigit) {
  const std::string csv = csv_of(table("sweep", false));
  EXPECT_EQ(csv.substr(0, csv.find("\r\n")),
            "point,key,repeat,seed,speed (m/s),law,outcome,exit_code,reason,error (m),"
            "result_speed (m/s)");
  EXPECT_NE(csv.find(",1,18446744073709551615,0.0001,pd,completed,0,,3.333333333333333e-07,\r\n"),
            std::string::npos)
      << csv;
  EXPECT_NE(csv.find("failed,1,\"lost, \"\"again\"\"\",,\r\n"), std::string::npos) << csv;
  EXPECT_EQ(csv.find("wall_time"), std::string::npos) << "it differs from machine to machine";
}

TEST_F(SweepTableTest, IsADatabaseThatSaysWhatWasVariedAndWhatWasFixed) {
  const SweepTable rows = table("sweep", false);
  const fs::path file = place_ / "sweep.sqlite";
  std::ofstream(file, std::ios::binary) << sqlite_of(rows, plan_of_twelve().head);
  Database database(file.string(), Database::Mode::read_only);
  const auto one = [&database](const std::string& query) {
    Statement row = database.prepare(query);
    return row.step() ? row.text(0) : std::string("nothing");
  };
  EXPECT_EQ(one("SELECT count(*) FROM points WHERE law='estimator' AND outcome='completed'"), "5");
  EXPECT_EQ(one("SELECT max(\"speed (m/s)\") FROM points_with_units"), "0.002");
  EXPECT_EQ(one("SELECT group_concat(name) FROM columns WHERE role='varied'"), "speed,law");
  EXPECT_EQ(one("SELECT unit FROM columns WHERE name='error'"), "m");
  EXPECT_EQ(one("SELECT value FROM fixed WHERE name='field'"), "0.01");
}

TEST_F(SweepTableTest, APointThatIsMissingHasItsRow) {
  const PointFolder folder = PointFolder::create(place_ / "sweep", plan_of_twelve());
  folder.mark(3, result_of(3));
  const SweepTable rows = read_table(folder);
  EXPECT_EQ(rows.rows.size(), 12U);
  EXPECT_EQ(rows.missing, 11U);
  EXPECT_EQ(text_in(rows.rows[0][rows.column("outcome")]), "missing");
}

TEST_F(SweepTableTest, MediansAndQuartilesAreThoseOfRAndNumpy) {
  // numpy.quantile([1, 2, 4, 8], [0.25, 0.5, 0.75]) = [1.75, 3, 5]
  const Spread spread = spread_of({8, 1, 4, 2});
  EXPECT_DOUBLE_EQ(spread.low, 1.75);
  EXPECT_DOUBLE_EQ(spread.median, 3);
  EXPECT_DOUBLE_EQ(spread.high, 5);
  EXPECT_TRUE(std::isnan(spread_of({}).median));
  EXPECT_DOUBLE_EQ(spread_of({7}).low, 7);
}

TEST_F(SweepTableTest, GroupsHoldTheCompletedRowsOfEachCombination) {
  const SweepTable rows = table("sweep", false);
  const auto varied = varied_columns(rows);
  ASSERT_EQ(varied.size(), 2U);
  EXPECT_EQ(varied[0].title(), "speed (mm/s)");
  EXPECT_EQ(varied[0].labels, (std::vector<std::string>{"0.1", "2"}));
  const auto groups = group_rows(rows, {&varied[0], &varied[1]});
  ASSERT_EQ(groups.size(), 4U);
  EXPECT_EQ(groups[0], (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_EQ(groups[1], (std::vector<std::size_t>{3, 5})) << "point 4 failed";
  EXPECT_EQ(settings_in(rows).size(), 4U);
}

TEST_F(SweepTableTest, TheReportShowsMapLinesFailuresAndTheSlowestAndEscapesWhatScriptsSay) {
  const SweepTable rows = table("sweep", false);
  const std::string page = sweep_report_html(rows, plan_of_twelve().head, "");
  EXPECT_NE(page.find("An &lt;experiment&gt;"), std::string::npos);
  EXPECT_EQ(page.find("<experiment>"), std::string::npos);
  EXPECT_NE(page.find("11 of 12 completed"), std::string::npos);
  EXPECT_NE(page.find("error (\u00b5m)"), std::string::npos);
  EXPECT_NE(page.find("lost, &quot;again&quot;"), std::string::npos);
  EXPECT_NE(page.find("speed (mm/s)"), std::string::npos);
  EXPECT_NE(page.find("n = 2"), std::string::npos) << "a cell with fewer repeats says so";
  EXPECT_NE(page.find("The slowest"), std::string::npos);
  EXPECT_EQ(page.find("nan"), std::string::npos);
  EXPECT_THROW(sweep_report_html(rows, plan_of_twelve().head, "eror"), std::runtime_error);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
