// SPDX-License-Identifier: Apache-2.0
#include "tests/host/record/run_fixture.h"

#include <Eigen/Core>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <stdlib.h>

namespace vitreo::test {
namespace {

constexpr int kRate = 15, kRows = 60 * kRate;
constexpr double kMillimeter = 1e-3;

/// The square of thesis figure 6.5: 8 mm along x by 6 mm of depth.
Eigen::Vector3d square_at(double part) {
  const double way = part * 28;
  if (way < 8) return {(-4 + way) * kMillimeter, 0, -3 * kMillimeter};
  if (way < 14) return {4 * kMillimeter, 0, (-3 + way - 8) * kMillimeter};
  if (way < 22) return {(4 - (way - 14)) * kMillimeter, 0, 3 * kMillimeter};
  return {-4 * kMillimeter, 0, (3 - (way - 22)) * kMillimeter};
}

cv::Mat picture_of_robot(std::mt19937& random) {
  cv::Mat image(300, 400, CV_8UC3);
  std::normal_distribution<double> noise(0, 4);
  for (int row = 0; row < image.rows; ++row) {
    for (int column = 0; column < image.cols; ++column) {
      const double gray = 150 - 60 * std::hypot(row - 150, column - 200) / 250 + noise(random);
      image.at<cv::Vec3b>(row, column) = {static_cast<unsigned char>(gray * 0.5),
                                          static_cast<unsigned char>(gray * 0.6),
                                          static_cast<unsigned char>(gray)};
    }
  }
  cv::ellipse(image, {210, 140}, {46, 15}, 8, 0, 360, {40, 40, 40}, cv::FILLED, cv::LINE_AA);
  cv::ellipse(image, {210, 140}, {47, 16}, 8, 0, 360, {80, 230, 60}, 1, cv::LINE_AA);
  return image;
}

struct ReferencePath {
  Series reference{"reference", {}, {}, Mark::dashed}, estimate{"estimate", {}, {}},
      truth{"truth", {}, {}};
  Series error{"3-D", {}, {}}, lateral{"lateral", {}, {}}, depth{"depth", {}, {}};
  std::vector<Series> currents;
};

void add(Series& series, double x, double y) {
  series.x.push_back(x);
  series.y.push_back(y);
}

void add_to(ReferencePath& course, double second, const Eigen::Vector3d& target,
            const Eigen::Vector3d& seen, const Eigen::Vector3d& robot) {
  const Eigen::Vector3d error = robot - target;
  add(course.reference, target.x(), target.z());
  add(course.estimate, seen.x(), seen.z());
  add(course.truth, robot.x(), robot.z());
  add(course.error, second, error.norm());
  add(course.lateral, second, std::hypot(error.x(), error.y()));
  add(course.depth, second, std::fabs(error.z()));
}

StreamInfo servo_stream() {
  StreamInfo servo{"servo", "top camera", {{"x", "m"}, {"y", "m"}, {"z", "m"}}};
  for (const char* name : {"target_x", "target_y", "target_z"})
    servo.channels.push_back({name, "m"});
  for (int coil = 1; coil <= 8; ++coil)
    servo.channels.push_back({"current_" + std::to_string(coil), "A"});
  return servo;
}

ReferencePath record_samples(Recorder& recorder, std::mt19937& random) {
  std::normal_distribution<double> normal(0, 1);
  const auto scatter = [&](double lateral, double depth) {
    const double x = normal(random), y = normal(random), z = normal(random);
    return Eigen::Vector3d(lateral * x, lateral * y, depth * z);
  };
  const int truth = recorder.add_stream(
      {"truth", "simulator truth (never seen by the loop)", {{"x", "m"}, {"y", "m"}, {"z", "m"}}});
  const int loop = recorder.add_stream(servo_stream());
  ReferencePath course;
  for (int coil = 1; coil <= 8; ++coil)
    course.currents.push_back({"coil " + std::to_string(coil), {}, {}});
  Eigen::Vector3d drift = Eigen::Vector3d::Zero();
  for (int row = 0; row < kRows; ++row) {
    const double second = row / static_cast<double>(kRate);
    const Eigen::Vector3d target = square_at(row / static_cast<double>(kRows));
    drift = 0.96 * drift + scatter(25e-6, 40e-6);
    const Eigen::Vector3d robot = target + drift;
    Eigen::Vector3d seen = robot + scatter(30e-6, 75e-6);
    if (row > 400 && row < 412) seen.setConstant(std::numeric_limits<double>::quiet_NaN());  // lost
    std::vector<double> values = {seen.x(), seen.y(), seen.z(), target.x(), target.y(), target.z()};
    for (std::size_t coil = 0; coil < 8; ++coil) {
      values.push_back(4 * std::sin(second / 9 + static_cast<double>(coil)) + 0.2 * normal(random));
      add(course.currents[coil], second, values.back());
    }
    recorder.sample(truth, from_seconds(second), std::array{robot.x(), robot.y(), robot.z()});
    recorder.sample(loop, from_seconds(second), values);
    add_to(course, second, target, seen, robot);
  }
  return course;
}

void record_plots(Recorder& recorder, const ReferencePath& course) {
  Plot side;
  side.title = "Seen from the side";
  side.x = {"x", "mm"};
  side.y = {"depth z", "mm"};
  side.equal_aspect = true;
  side.series = {course.reference, course.estimate, course.truth};
  side.note = "truth: the simulator's, never seen by the loop";
  recorder.plot(side);
  Plot top = side;
  top.title = "Seen from the top";
  top.y.label = "y";
  for (Series& series : top.series) {
    for (double& value : series.y) value *= 0.03;
  }
  recorder.plot(top);
  recorder.plot({"Error against the reference at the same time",
                 {"time", "s"},
                 {"error", "um"},
                 false,
                 {course.error, course.lateral, course.depth},
                 ""});
  recorder.plot({"Localization error by depth",
                 {"depth", "mm"},
                 {"error", "um"},
                 false,
                 {{"frames", course.truth.y, course.depth.y, Mark::points}},
                 ""});
  recorder.plot({"Currents", {"time", "s"}, {"current", "A"}, false, course.currents, ""});
}

}  // namespace

TemporaryFolder::TemporaryFolder() {
  std::string name = (std::filesystem::temp_directory_path() / "vitreo_test_XXXXXX").string();
  if (!mkdtemp(name.data())) throw std::runtime_error("no temporary folder");
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

RunStart servo_start() {
  RunStart start;
  start.protocol_file = "protocols/servo_square.lua";
  start.protocol_title = "Servo round the square of figure 6.5";
  start.protocol_text =
      "-- servo_square\nreturn { title = \"Servo round the square of figure 6.5\" }\n";
  start.parameters = {
      {"speed", 0.5e-3}, {"field", 0.01}, {"feedback", "one_camera"}, {"laps", 1}, {"trim", true}};
  start.parameter_units = {{"speed", "mm/s"}, {"field", "mT"}};
  start.rig = {{"file", "scripts/rigs/simulated.lua"},
               {"text", "return {\n  top_camera = { focus = 12.3*mm },\n}\n"},
               {"top_camera", {{"focus", 0.0123}, {"rate", 15}, {"size_px", {1384, 1036}}}},
               {"coils", {{"limit", 19.0}, {"count", 8}}}};
  start.versions = {{"vitreo", "0.1.0"}, {"Lua", "5.4.4"}, {"Eigen", "3.4.0"}, {"OpenCV", "4.6.0"}};
  start.seed = 18446744073709551615u;
  start.operator_name = "night job";
  return start;
}

void record_servo_run(Recorder& recorder) {
  std::mt19937 random(7);
  recorder.event(Time{0}, "started", "background learnt from 20 images");
  const ReferencePath course = record_samples(recorder, random);
  record_plots(recorder, course);
  recorder.event(from_seconds(4.2), "checkpoint", "before the first corner");
  recorder.event(from_seconds(26.7), "alarm", "robot lost for 0.8 s");
  recorder.event(from_seconds(60), "checkpoint", "square closed");
  recorder.result({"path_error_rms", 187e-6, "m"});
  recorder.result({"localization_error_mean", 92.4e-6, "m"});
  recorder.result({"localization_error_max", 0.41e-3, "m"});
  recorder.result({"experiment_time", 60.4, "s"});
  recorder.result({"wall_time", 8.31, "s"});
  recorder.table({"Localization error beside thesis table 5.4",
                  {"direction", "mean (\u00b5m)", "max (\u00b5m)", "thesis"},
                  {{"lateral", "61", "182", "70"}, {"depth", "74", "398", "190"}}});
  recorder.picture("first corner", "First corner: the ellipse that the tracker fitted (green)",
                   picture_of_robot(random));
  recorder.picture("mid-depth", "", picture_of_robot(random));
  recorder.picture("end", "Back at the first corner after 60 s", picture_of_robot(random));
}

namespace {

/// Reads one tag at `at` (on '<'); returns its end. Opened names are pushed, closed ones popped.
std::size_t read_tag(const std::string& text, std::size_t at, std::vector<std::string>& open,
                     std::string* what) {
  std::size_t i = at + 1;
  const bool closing = text[i] == '/';
  if (closing) ++i;
  std::string name;
  while (i < text.size() && (std::isalnum(static_cast<unsigned char>(text[i])) || text[i] == '!'))
    name += text[i++];
  char quote = 0;
  for (; i < text.size() && (quote != 0 || text[i] != '>'); ++i) {
    if (quote == 0 && text[i] == '<') *what = "'<' inside <" + name;
    if (text[i] == '"') quote = quote != 0 ? '\0' : '"';
  }
  if (i >= text.size() || name.empty()) *what = "a tag does not end: <" + name;
  const bool is_void = text[i - 1] == '/' || name == "meta" || name == "img" || name == "!DOCTYPE";
  if (closing) {
    if (open.empty() || open.back() != name)
      *what = "</" + name + "> closes " + (open.empty() ? "nothing" : open.back());
    if (!open.empty()) open.pop_back();
  } else if (!is_void) {
    open.push_back(name);
  }
  return i + 1;
}

}  // namespace

bool well_formed(const std::string& markup, std::string* what) {
  std::vector<std::string> open;
  what->clear();
  for (std::size_t i = 0; i < markup.size() && what->empty();) {
    if (markup[i] == '<') {
      i = read_tag(markup, i, open, what);
      // What stands in these is no markup.
      if (!open.empty() && (open.back() == "style" || open.back() == "script"))
        i = std::min(markup.find("</" + open.back() + ">", i), markup.size());
    } else if (markup[i] == '&') {
      const std::size_t end = markup.find(';', i);
      const std::string entity = end == std::string::npos ? "" : markup.substr(i, end - i + 1);
      const bool known = entity == "&amp;" || entity == "&lt;" || entity == "&gt;" ||
                         entity == "&quot;" || entity == "&#39;";
      if (!known) *what = "'&' that starts no entity";
      ++i;
    } else {
      ++i;
    }
  }
  if (what->empty() && !open.empty()) *what = "<" + open.back() + "> is not closed";
  return what->empty();
}

TEST(RunFixture, TheMarkupCheckSeesWhatIsWrong) {
  std::string what;
  EXPECT_TRUE(well_formed("<a b=\"<\"><c/>&amp;</a>", &what)) << what;
  for (const char* bad : {"<a>", "</a>", "<a></b>", "a & b", "<a", "<a><b></a></b>", "<a <b>"}) {
    EXPECT_FALSE(well_formed(bad, &what)) << bad;
  }
}

}  // namespace vitreo::test
