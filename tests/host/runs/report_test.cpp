// SPDX-License-Identifier: Apache-2.0
#include "host/runs/report.h"

#include "host/runs/report_files.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>

namespace vitreo {
namespace {

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// The page alone must do: nothing that a browser would fetch or run.
void expect_self_contained(const std::string& page) {
  EXPECT_FALSE(contains(page, "<script"));
  EXPECT_FALSE(contains(page, "<link") || contains(page, "<iframe") || contains(page, "@import") ||
               contains(page, "url("));
  for (std::size_t at = page.find('<'); at != std::string::npos; at = page.find('<', at + 1)) {
    const std::string tag = page.substr(at, std::min<std::size_t>(page.find('>', at) - at, 300));
    EXPECT_FALSE(contains(tag, "href=") || contains(tag, " on")) << tag;
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
        ">187 <span class=\"unit\">\u00b5m", "0.5\u00a0mm/s", "10\u00a0mT", "robot lost for 0.8 s",
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
  EXPECT_FALSE(contains(page, "<script") || contains(page, "<img src=x"));
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
      "<svg xmlns=\"http://www.w3.org/2000/svg\"><script>alert(1)</script></svg>";
  recorder.drawing("The \"lens\"", svg);
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
  EXPECT_FALSE(contains(page, "<script"));
  const std::size_t drawing =
      page.find("<img alt=\"The &quot;lens&quot;\" src=\"data:image/svg+xml;base64,");
  ASSERT_NE(drawing, std::string::npos);
  EXPECT_LT(drawing, page.find("<svg"));
}

}  // namespace
}  // namespace vitreo
