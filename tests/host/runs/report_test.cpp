// SPDX-License-Identifier: Apache-2.0
#include "host/runs/report.h"

#include "host/record/record_json.h"
#include "host/runs/report_files.h"
#include "host/runs/report_page.h"
#include "host/runs/report_parts.h"
#include "host/text/markup.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace vitreo {
namespace VITREO_TEST_FILE {

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1))
    ++count;
  return count;
}

/// The page alone must do: nothing that a browser would fetch, and it runs the program's own script
/// alone.
void expect_self_contained(const std::string& whole) {
  EXPECT_EQ(count_of(whole, "<script"), 1U);
  EXPECT_TRUE(contains(whole, "<script>" + std::string(report_script()) + "</script>"));
  const std::string page = whole.substr(0, whole.find("<script>"));
  EXPECT_FALSE(contains(page, "<link") || contains(page, "<iframe") || contains(page, "@import") ||
               contains(page, "url("));
  for (std::size_t at = page.find('<'); at != std::string::npos; at = page.find('<', at + 1)) {
    const std::string tag = page.substr(at, std::min<std::size_t>(page.find('>', at) - at, 300));
    EXPECT_FALSE(contains(tag, " on")) << tag;
    if (const std::size_t link = tag.find("href="); link != std::string::npos) {
      EXPECT_EQ(tag.substr(link + 6, 21), "data:text/csv;base64,");
    }
    const std::size_t source = tag.find("src=\"");
    if (source == std::string::npos || tag.starts_with("<meta")) continue;
    EXPECT_EQ(tag.substr(source + 5, 23), "data:image/jpeg;base64,");
  }
  const std::string name_space =
      "xmlns=\"http://www.w3.org/2000/svg\"";  // a name, nothing is loaded
  for (std::size_t at = page.find("http"); at != std::string::npos;
       at = page.find("http", at + 1)) {
    const bool fine = (at >= 7 && page.compare(at - 7, name_space.size(), name_space) == 0) ||
                      page.compare(at, 11, "http-equiv=") == 0;
    EXPECT_TRUE(fine) << page.substr(at, 60);
  }
}

class Report : public testing::Test {
 protected:
  test::TemporaryFolder parent_;
};

TEST_F(Report, ShowsWhatHowAndWhenInPeoplesUnits) {
  test::ReportedRecorder recorder(parent_.path(), test::servo_start());
  test::record_servo_run(recorder);
  recorder.finish({Outcome::completed, "", 60.4, 8.3});
  const std::string page = test::read_file(recorder.folder() / "report.html");
  std::string what;
  EXPECT_TRUE(test::well_formed(page, &what)) << what;
  expect_self_contained(page);
  for (const char* part :
       {"Servo round the square of figure 6.5", "completed", "night job", "path error rms",
        ">187 <small>\u00b5m", "0.5\u00a0mm/s", "10\u00a0mT", "robot lost for 0.8 s",
        "top_camera.focus = 0.0123", "18446744073709551615", "Seen from the side",
        "Localization error beside thesis table 5.4", "First corner"}) {
    EXPECT_TRUE(contains(page, part)) << part;
  }
}

TEST_F(Report, KeepsTheProtocolsOrderOfPlots) {
  test::ReportedRecorder recorder(parent_.path(), test::servo_start());
  test::record_servo_run(recorder);
  const std::string page = report_html(recorder);
  std::size_t last = 0;
  for (const Plot& plot : recorder.plots()) {
    const std::size_t at = page.find("<title>" + plot.title + "</title>");
    ASSERT_NE(at, std::string::npos);
    EXPECT_GT(at, last);
    last = at;
  }
}

TEST_F(Report, WhatScriptsWriteStaysText) {
  const std::string evil =
      "<script>fetch('https' + x)</script><img src=x onerror=alert(1)>&\"'\xff";
  RunStart start = test::servo_start();
  start.protocol_title = start.protocol_text = start.operator_name = evil;
  start.parameters = {{evil, evil}};
  start.versions = {{evil, evil}};
  start.rig = {{"file", evil}, {evil, {{evil, evil}}}, {"text", evil}};
  test::ReportedRecorder recorder(parent_.path(), start);
  const int stream = recorder.add_stream({evil, evil, {{evil, evil}}});
  recorder.sample(stream, Time{0}, std::array{1.0});
  recorder.result({evil, 1, evil});
  recorder.event(Time{0}, evil, evil);
  recorder.table({evil, {evil, evil}, {{evil, evil}, {evil}}});
  recorder.picture(evil, evil, cv::Mat::zeros(4, 4, CV_8U));
  Plot plot;
  plot.title = plot.note = evil;
  recorder.plot(plot);
  recorder.finish({Outcome::failed, evil, 0, 0});
  const std::string page = test::read_file(recorder.folder() / "report.html");
  std::string what;
  EXPECT_TRUE(test::well_formed(page, &what)) << what;
  EXPECT_EQ(count_of(page, "<script"), 1U);
  EXPECT_FALSE(contains(page, "<img src=x"));
  EXPECT_FALSE(contains(page, "\xff"));
}

TEST_F(Report, OfAnEmptyRunIsWhole) {
  test::ReportedRecorder recorder(parent_.path(), RunStart{});
  recorder.finish({Outcome::aborted, "", 0, 0});
  const std::string page = test::read_file(recorder.folder() / "report.html");
  std::string what;
  EXPECT_TRUE(test::well_formed(page, &what)) << what;
  expect_self_contained(page);
  EXPECT_TRUE(contains(page, "aborted"));
}

TEST_F(Report, ThousandsOfEventsAreFolded) {
  test::ReportedRecorder recorder(parent_.path(), test::servo_start());
  for (int i = 0; i < 300; ++i) recorder.event(Time{i}, "note", "number " + std::to_string(i));
  const std::string page = report_html(recorder);
  EXPECT_TRUE(contains(page, "240 more events"));
  EXPECT_TRUE(contains(page, "number 299"));
}

TEST_F(Report, ResultsThatAreNoNumbersAreSaidToBeNone) {
  test::ReportedRecorder recorder(parent_.path(), test::servo_start());
  recorder.result({"lost", std::numeric_limits<double>::quiet_NaN(), "m"});
  recorder.result({"steps", -1.5, "um"});
  const std::string page = report_html(recorder);
  EXPECT_TRUE(contains(page, "not a number"));
  EXPECT_TRUE(contains(
      page, ">\u22121500000 <span class=\"unit\">\u00b5m<"));  // the protocol's own unit is kept
}

TEST_F(Report, ShowsDrawingsBeforeThePlotsAsImagesThatCannotRun) {
  test::ReportedRecorder recorder(parent_.path(), test::servo_start());
  recorder.plot(
      {"Error", {"time", "s"}, {"error", "um"}, false, {{"a", {0, 1}, {0, 1}, Mark::line}}, ""});
  const std::string svg =
      "<svg xmlns=\"http://www.w3.org/2000/svg\"><circle "
      "r=\"3\"><title>lens</title></circle></svg>";
  recorder.drawing("The \"lens\"", svg);
  EXPECT_THROW(
      recorder.drawing("a program",
                       "<svg xmlns=\"http://www.w3.org/2000/svg\"><script>alert(1)</script>"
                       "</svg>"),
      std::invalid_argument)
      << "the file in plots/ may be opened by itself, where it would run";
  EXPECT_THROW(recorder.drawing("no drawing", "<b>bold</b>"), std::invalid_argument);
  EXPECT_THROW(recorder.drawing("half a drawing", svg.substr(0, 50)), std::invalid_argument);
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(test::read_file(recorder.folder() / "plots/01_The_lens.svg"), svg);
  EXPECT_TRUE(std::filesystem::exists(recorder.folder() / "plots/02_Error.svg"));
  for (const auto& file : write_plots(recorder.data(), parent_.path() / "again"))
    EXPECT_EQ(test::read_file(file), test::read_file(recorder.folder() / "plots" / file.filename()))
        << file << ": one figure has one number and one name";
  const std::string page = test::read_file(recorder.folder() / "report.html");
  std::string what;
  EXPECT_TRUE(test::well_formed(page, &what)) << what;
  EXPECT_EQ(count_of(page, "<script"), 1U);
  const std::size_t drawing =
      page.find("<img alt=\"The &quot;lens&quot;\" src=\"data:image/svg+xml;base64,");
  ASSERT_NE(drawing, std::string::npos);
  EXPECT_LT(drawing, page.find("<svg"));
}

// Read first: what was done, whether it is good, and the number that matters.
TEST_F(Report, BeginsWithTheSentenceTheNumberAndItsVerdict) {
  test::ReportedRecorder recorder(parent_.path(), test::servo_start());
  recorder.result({"verdict_goal_met", 1, ""});
  recorder.result({"path_error_rms", 137e-6, "m"});
  recorder.table(
      {"Beside the thesis",
       {"where", "what", "thesis", "ours", "measure", "verdict", "why"},
       {{"6.2", "path error", "\u2013", "137 \u00b5m", "at most 300 \u00b5m", "goal met", ""},
        {"5.4", "depth", "249 \u00b5m", "109 \u00b5m", "\u00b1 177 \u00b5m", "reproduced", ""},
        {"5.4", "width", "1 mm", "2 mm", "\u00b1 0.1 mm", "differs", "why"},
        {"6.1", "drift", "1 mm", "3 mm", "\u00b1 0.1 mm", "differs, 4.8 spreads", "why"}}});
  recorder.event(Time{0}, "headline", "Square followed to 150 \u00b5m");
  recorder.event(Time{1}, "headline", "Square followed to 137 \u00b5m");
  recorder.finish({Outcome::completed, "", 60, 8});
  const std::string page = test::read_file(recorder.folder() / "report.html");
  EXPECT_TRUE(contains(page, "<h1>Square followed to 137 \u00b5m</h1>")) << "the last one counts";
  const std::size_t number = page.find(">137 <small>\u00b5m"), first = page.find("goal met");
  ASSERT_NE(number, std::string::npos);
  EXPECT_LT(page.find("<h1>"), number);
  EXPECT_LT(number, first);
  EXPECT_LT(first, page.find("class=\"facts\"")) << "who and when stand at the foot";
  EXPECT_TRUE(contains(page, "2 differs, 1 goal met, 1 reproduced.")) << "counted apart";
  EXPECT_TRUE(contains(page, "<b class=\"verdict bad\">differs</b>"));
  EXPECT_TRUE(contains(page, "<b class=\"verdict bad\">differs, 4.8 spreads</b>"));
  EXPECT_TRUE(contains(page, "<b class=\"verdict good\">goal met</b><br>at most 300"));
  EXPECT_FALSE(contains(page, "in the thesis \u2013")) << "which prints none";
  const std::size_t measure = page.find(">measure<");
  EXPECT_LT(measure, page.find("class=\"facts\"")) << "in the table at the head, too";
}

TEST_F(Report, OfAFailedRunSaysWhatFailedAndWhatIsKept) {
  test::ReportedRecorder recorder(parent_.path(), test::servo_start());
  recorder.event(Time{0}, "headline", "Square followed to 137 \u00b5m");
  recorder.sample(recorder.add_stream({"servo", "", {{"x", "m"}}}), Time{0}, std::array{1.0});
  recorder.finish({Outcome::failed, "the robot was lost", 60, 8});
  const std::string page = test::read_file(recorder.folder() / "report.html");
  EXPECT_TRUE(contains(page, "figure 6.5: failed</h1>")) << "no success is told";
  EXPECT_TRUE(contains(page, "the robot was lost"));
  EXPECT_TRUE(contains(page, "Kept: 1 samples in 1 streams"));
}

TEST_F(Report, ItsScriptIsSmallAndTheOnlyOneThatMayRun) {
  EXPECT_LE(report_script().size(), 30000U);
  const std::string page =
      filled_page({.title = "t", .sections = "<script>1</script>", .foot = ""});
  const std::size_t at = page.find("script-src 'sha256-");
  ASSERT_NE(at, std::string::npos);
  EXPECT_EQ(page[at + 19 + 44], '\'') << "32 bytes in base64, and nothing beside them";
}

TEST_F(Report, EachPlotBringsItsDataWholeInTheAxesUnits) {
  Plot plot{"Error",
            {"time", "s"},
            {"error", "um"},
            false,
            {{"a", {0, 1}, {0, 1e-6}, Mark::points, {2e-7, 2e-7}}},
            ""};
  plot.series.push_back(
      {"b, of x", {0, 1}, {std::numeric_limits<double>::quiet_NaN(), 3e-6}, Mark::line});
  const std::string csv = plot_csv(plot);
  EXPECT_EQ(csv, "series,time (s),error (\u00b5m),half bar\n0,0,0,0.2\n0,1,1,0.2\n1,0,,\n1,1,3,\n");
  test::ReportedRecorder recorder(parent_.path(), test::servo_start());
  recorder.plot(plot);
  const std::string page = report_html(recorder);
  const std::vector<unsigned char> bytes(csv.begin(), csv.end());
  EXPECT_TRUE(contains(page, "href=\"data:text/csv;base64," + base64(bytes) + "\""));
}

TEST_F(Report, APlotComesBackFromTheRecordWithAllThatItHas) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Plot plot{"Error",
            {"field", "mT", true},
            {"error", "um"},
            false,
            {{"a", {1, 2}, {3, 4}, Mark::points, {5, 6}}},
            ""};
  plot.expected = {{"goal", -kInfinity, 3e-4}};
  plot.annotations = {{"here", 1}, {"there", 2, 3}};
  const Plot back = plot_from_json(plot_json(plot));
  EXPECT_TRUE(back.x.logarithmic);
  EXPECT_FALSE(back.y.logarithmic);
  EXPECT_EQ(back.series[0].spread, plot.series[0].spread);
  EXPECT_EQ(back.expected[0].low, -kInfinity);
  EXPECT_EQ(back.expected[0].high, 3e-4);
  EXPECT_TRUE(std::isnan(back.annotations[0].y));
  EXPECT_EQ(back.annotations[1].y, 3);
  EXPECT_EQ(plot_json(back), plot_json(plot));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
