// SPDX-License-Identifier: Apache-2.0
#include "host/trials/reproduction_joined.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

ConfigValue table(ConfigTable entries) { return {std::move(entries)}; }
ConfigValue list(std::initializer_list<const char*> texts) {
  ConfigList made;
  for (const char* text : texts) made.push_back({std::string(text)});
  return {made};
}

RigDescription plan() {
  RigDescription file;
  file.file = "plan.lua";
  file.table["a_run"] = table({{"protocol", {std::string("hold")}}});
  file.table["b_joined"] = table({{"joins", list({"one", "two"})},
                                  {"id", {std::string("both")}},
                                  {"what", {std::string("error of both")}},
                                  {"unit", {std::string("m")}},
                                  {"at_most", {160e-6}}});
  return file;
}

ReproducedRun run_with(const std::string& id, double ours, std::vector<double> values) {
  ReproducedRun run;
  run.plan.rig = "simulated";
  run.outcome = "completed";
  ReproducedRow row;
  row.id = id, row.unit = "m", row.ours = ours, row.values = std::move(values);
  run.rows.push_back(row);
  return run;
}

TEST(ReproductionJoined, AJoinedRowIsTheMedianOfAllTheValuesAndNoRun) {
  const RigDescription file = plan();
  EXPECT_EQ(read_plan(file).size(), 1U) << "a joined row is nothing to run";
  const std::vector<JoinedRow> wanted = read_joined(file);
  ASSERT_EQ(wanted.size(), 1U);
  std::vector<ReproducedRun> runs{run_with("one", 200e-6, {100e-6, 200e-6, 300e-6}),
                                  run_with("two", 10e-6, {})};
  const ReproducedRun together = join_rows(wanted, runs, true);
  ASSERT_EQ(together.rows.size(), 1U);
  const ReproducedRow& row = together.rows[0];
  EXPECT_EQ(row.id, "both");
  EXPECT_DOUBLE_EQ(row.ours, 150e-6);  // of 10, 100, 200, 300; not the mean of the medians, 105
  EXPECT_EQ(row.verdict, "goal met") << "it is of no number of the thesis";
  EXPECT_NE(row.what.find("4 values"), std::string::npos);
  EXPECT_NE(row.why.find("one: 200 µm"), std::string::npos) << row.why;
  runs.push_back(together);
  EXPECT_NE(reproduction_markdown(runs).find("0 of 2 runs did not complete"), std::string::npos);
  runs[1].rows[0].ours = 2e-3;
  EXPECT_EQ(join_rows(wanted, runs, true).rows[0].verdict, "goal missed");
}

TEST(ReproductionJoined, WhatIsMissingIsNamedAndIsNoAnswerUnlessOnlyAPartWasRun) {
  const std::vector<JoinedRow> wanted = read_joined(plan());
  const std::vector<ReproducedRun> runs{run_with("one", 200e-6, {})};
  EXPECT_TRUE(join_rows(wanted, runs, false).rows.empty());
  const ReproducedRun together = join_rows(wanted, runs, true);
  ASSERT_EQ(together.rows.size(), 1U);
  EXPECT_TRUE(std::isnan(together.rows[0].ours));
  EXPECT_TRUE(is_missed(together.rows[0]));
  EXPECT_EQ(together.rows[0].why, "missing: two");
}

TEST(ReproductionJoined, AMalformedEntryIsRefusedByName) {
  const auto said = [](const std::function<void(ConfigTable&)>& spoil) {
    RigDescription file = plan();
    spoil(std::get<ConfigTable>(file.table["b_joined"].value));
    try {
      read_joined(file);
    } catch (const ConfigError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(said([](ConfigTable& t) {
              t["joins"] = {3.0};
            }).find("b_joined.joins must be a list of texts"),
            std::string::npos);
  EXPECT_NE(said([](ConfigTable& t) { t["joins"] = {ConfigList{{3.0}}}; }).find("number 1 is"),
            std::string::npos);
  EXPECT_NE(said([](ConfigTable& t) { t.erase("what"); }).find("b_joined.what must be given"),
            std::string::npos);
  EXPECT_NE(said([](ConfigTable& t) { t["atmost"] = {1.0}; }).find("did you mean at_most"),
            std::string::npos);
}

TEST(Reproduction, VerdictsAreCountedApartAndWhatDiffersNeedsACause) {
  ReproducedRun run = run_with("cell", 33e-6, {});
  run.rows[0].verdict = "differs";
  run.rows[0].deviation = 4.12;
  EXPECT_TRUE(is_missed(run.rows[0]));
  ReproducedRow known = run.rows[0];
  known.why = "the thesis gives no coordinates";
  EXPECT_FALSE(is_missed(known));
  ReproducedRow goal = known;
  goal.verdict = "goal missed", goal.deviation.reset();
  EXPECT_TRUE(is_missed(goal)) << "a cause does not meet a goal";
  ReproducedRow old = known;
  old.verdict = "agrees";
  EXPECT_TRUE(is_missed(old)) << "a word that is none of the six";
  run.rows.insert(run.rows.end(), {known, goal});
  const std::string page = reproduction_markdown({run});
  for (const char* part :
       {"1 goal missed, 2 differ; of what differs 1 is without a cause",
        "| **differs, 4.1 spreads** |", "| differs, 4.1 spreads |", "| **goal missed** |"})
    EXPECT_NE(page.find(part), std::string::npos) << part << page;
  const std::string html = reproduction_page({run}, "/");
  EXPECT_NE(html.find("<tr class=\"differs\">"), std::string::npos) << html;
}

TEST(Reproduction, ThesisAndOursAreInOneUnit) {
  ReproducedRun run = run_with("wide", 1.25e-3, {});
  run.rows[0].thesis = 300e-6;
  run.rows[0].tolerance = "100 um to 2 mm (this project's goal)";
  run.rows[0].why = "moved by 40 um";
  ReproducedRow small = run.rows[0];
  small.ours = 12.5e-6;
  small.thesis.reset();
  small.tolerance = "none";
  ReproducedRow other = run.rows[0];
  other.unit = "rad";
  other.ours = 0.5235987755982988;
  other.thesis.reset();
  other.tolerance = "none";
  run.rows.insert(run.rows.end(), {small, other});
  const std::string page = reproduction_page({run}, "/");
  EXPECT_NE(page.find("<td>300 \u00b5m<td>1250 \u00b5m<td>\u2013<td>100 \u00b5m to 2000 \u00b5m "
                      "(this project's"),
            std::string::npos)
      << page;
  for (const char* part :
       {"<td>\u2013<td>12.5 \u00b5m<td>\u2013<td>none", "<td>30\u00b0", "moved by 40 \u00b5m"})
    EXPECT_NE(page.find(part), std::string::npos) << part << page;
  EXPECT_EQ(page.find(" um"), std::string::npos);
  EXPECT_NE(reproduction_markdown({run}).find("| 300 \u00b5m | 1250 \u00b5m |"), std::string::npos);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
