// Topics of a run: what is left out, what is drawn, and the rules by which readers refuse a topic.
// The reference schemas and readers judge them in tests/program/exports_test.cpp.
// SPDX-License-Identifier: Apache-2.0
#include "host/channels/run_topics.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using nlohmann::json;

constexpr std::int64_t kZero = 1795534354000000000;  // ns since 1970: 2026-11-24T15:32:34Z

StreamInfo servo() {
  StreamInfo info{"servo", "test", {}};
  for (const char* name :
       {"x", "y", "z", "target_x", "target_y", "target_z", "u_px", "v_px", "semi_major_px",
        "semi_minor_px", "angle", "sigma_x", "sigma_y", "sigma_z"})
    info.channels.push_back({name, ""});
  return info;
}

RunStart with_geometry() {
  RunStart start;
  start.rig = {{"geometry",
                {{"eye_x", 0.0},
                 {"eye_y", 0.0},
                 {"eye_z", -5e-3},
                 {"retina_radius", 12e-3},
                 {"lens_z", 12e-3},
                 {"robot_semi_axis", 1e-3},
                 {"robot_semi_radius", 0.5e-3}}}};
  return start;
}

/// The message of a topic, of one row.
std::optional<json> message(const RunTopics& topics, const StreamInfo& stream,
                            const std::string& name, const std::vector<double>& row) {
  for (const RowTopic& one : topics.of_stream(stream))
    if (one.topic.name == name) {
      const auto text = one.message(std::chrono::milliseconds(2500), row);
      return text ? std::optional(json::parse(*text)) : std::nullopt;
    }
  ADD_FAILURE() << name << " is no topic of " << stream.name;
  return {};
}

const std::vector<double> kSeen{1e-3, 2e-3, 3e-3, 0, 0, 0, 100, 50, 10, 5, 0, 1e-5, 1e-5, 4e-5};

TEST(RunTopics, LeaveOutWhatIsNoNumberAndNameTheUnits) {
  const StreamInfo stream{"currents", "set points", {{"i1", "A"}, {"share", ""}}};
  const RunTopics topics({}, kZero);
  const json content = *message(topics, stream, "/currents", {1.5, std::nan("")});
  EXPECT_EQ(content, json({{"i1", 1.5}}));
  const Topic topic = topics.of_stream(stream).front().topic;
  EXPECT_EQ(topic.schema["properties"]["i1"]["type"], "number");
  EXPECT_EQ(topic.schema["properties"]["i1"]["description"], "[A]");
  EXPECT_EQ(topic.schema["properties"]["share"]["description"], "[1]");
}

TEST(RunTopics, AreStampedWithTheWallClock) {
  const json pose = *message({{}, kZero}, servo(), "/robot/pose", kSeen);
  EXPECT_EQ(pose["timestamp"], json({{"sec", 1795534356}, {"nsec", 500000000}}));
  EXPECT_EQ(pose["frame_id"], "world");
  EXPECT_EQ(pose["pose"]["position"], json({{"x", 1e-3}, {"y", 2e-3}, {"z", 3e-3}}));
  // Before 1970 nothing lies: MCAP's times are unsigned.
  EXPECT_EQ(UtcClock(0).ns(std::chrono::seconds(-1)), 0U);
}

TEST(RunTopics, SayNothingOfARobotThatWasNotSeen) {
  std::vector<double> lost = kSeen;
  for (const std::size_t i : {0U, 1U, 2U, 6U, 7U, 8U, 9U, 10U}) lost[i] = std::nan("");
  const RunTopics topics(with_geometry(), kZero);
  EXPECT_EQ(message(topics, servo(), "/robot/pose", lost), std::nullopt);
  EXPECT_TRUE(message(topics, servo(), "/target/pose", lost).has_value());
  const json annotations = *message(topics, servo(), "/top_camera/annotations", lost);
  EXPECT_TRUE(annotations["points"].empty()) << "an old outline would stay on the picture";
  const json scene = *message(topics, servo(), "/scene", lost);
  ASSERT_EQ(scene["deletions"].size(), 1U);
  EXPECT_EQ(scene["deletions"][0]["id"], "robot");
  EXPECT_EQ(scene["entities"].size(), 1U);
}

TEST(RunTopics, DrawTheEllipseOfTheTrackerOnThePixelsThatFoxgloveCounts) {
  const json outline =
      (*message({{}, kZero}, servo(), "/top_camera/annotations", kSeen))["points"][0]["points"];
  double left = 1e9, right = 0, top = 1e9, bottom = 0;
  for (const json& point : outline) {
    left = std::min(left, point["x"].get<double>());
    right = std::max(right, point["x"].get<double>());
    top = std::min(top, point["y"].get<double>());
    bottom = std::max(bottom, point["y"].get<double>());
  }
  // Center (100, 50) and half axes 10 and 5; half a pixel more, for the corner is Foxglove's zero.
  EXPECT_NEAR(left, 90.5, 1e-9);
  EXPECT_NEAR(right, 110.5, 1e-9);
  EXPECT_NEAR(top, 45.5, 1e-9);
  EXPECT_NEAR(bottom, 55.5, 1e-9);
}

TEST(RunTopics, DrawNoOrientationThatIsNotKnown) {
  const json robot = (*message({with_geometry(), kZero}, servo(), "/scene", kSeen))["entities"][0];
  const json& ball = robot["spheres"][0]["size"];
  EXPECT_EQ(ball, json({{"x", 2e-3}, {"y", 2e-3}, {"z", 2e-3}})) << "the length all round";
  EXPECT_EQ(robot["metadata"][0]["value"], "not recorded");
  // Three standard deviations to each side.
  EXPECT_NEAR(robot["spheres"][1]["size"]["z"].get<double>(), 6 * 4e-5, 1e-12);
  // With an axis: along it, and as thin as it is.
  StreamInfo with_axis = servo();
  for (const char* name : {"axis_x", "axis_y", "axis_z"}) with_axis.channels.push_back({name, ""});
  std::vector<double> row = kSeen;
  row.insert(row.end(), {0, 0, 1});
  const json known =
      (*message({with_geometry(), kZero}, with_axis, "/scene", row))["entities"][0]["spheres"][0];
  EXPECT_EQ(known["size"], json({{"x", 2e-3}, {"y", 1e-3}, {"z", 1e-3}}));
  // x to z: a quarter turn about -y.
  EXPECT_NEAR(known["pose"]["orientation"]["w"].get<double>(), std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(known["pose"]["orientation"]["y"].get<double>(), -std::sqrt(0.5), 1e-12);
}

TEST(RunTopics, HaveNoEyeWhereTheRecordHasNoGeometry) {
  EXPECT_EQ(RunTopics({}, kZero).scene_message(Time{0}), std::nullopt);
  EXPECT_TRUE(RunTopics(with_geometry(), kZero).scene_message(Time{0}).has_value());
  RunStart broken;
  broken.rig = {{"geometry", {{"retina_radius", "large"}}}};
  EXPECT_EQ(RunTopics(broken, kZero).scene_message(Time{0}), std::nullopt);
}

TEST(RunTopics, LogAlarmsByTheirPriorityAndScriptErrorsByTheirLine) {
  const RunTopics topics({}, kZero);
  const auto logged = [&](const char* kind, const char* text) {
    return json::parse(topics.log_message(Time{0}, kind, text));
  };
  EXPECT_EQ(logged("alarm", "high: interlock: coil 3")["level"], 4);
  EXPECT_EQ(logged("alarm", "low: disk: slow")["level"], 3);
  EXPECT_EQ(logged("note", "high tide")["level"], 2);
  const json error = logged("error", "protocols/drift.lua:12: no robot");
  EXPECT_EQ(error["level"], 4);
  EXPECT_EQ(error["file"], "protocols/drift.lua");
  EXPECT_EQ(error["line"], 12);
  EXPECT_EQ(logged("note", "\xff\xfe")["message"], "\uFFFD\uFFFD") << "text that is no UTF-8";
}

TEST(RunTopics, TakeTheRowsOfPicturesWithMoreThanEightBitsAsTheyAre) {
  const RunTopics topics({}, kZero);
  const cv::Mat whole(4, 6, CV_16UC1, cv::Scalar(0x0FFF));
  const json image = json::parse(topics.image_message(
      "top_camera", Time{0}, whole(cv::Rect(1, 1, 2, 2)), ImageCoding::lossless));
  EXPECT_EQ(image["encoding"], "mono16");
  EXPECT_EQ(image["step"], 4);
  EXPECT_EQ(image["data"], "/w//D/8P/w8=") << "FF 0F four times";
}

TEST(FoxgloveSchemas, AreOfTheTableAlone) {
  EXPECT_THROW(foxglove_schema("Sandwich"), std::invalid_argument);
  EXPECT_EQ(foxglove_schema("Log")["title"], "foxglove.Log");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
