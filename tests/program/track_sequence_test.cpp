// protocols/track_sequence.lua as people run it: folders of files in, track.csv and results out.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/vision/needle_scene.h"
#include "tests/vision/sequence_files.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include <cmath>
#include <sstream>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

std::vector<std::vector<std::string>> rows_of(const std::string& csv) {
  std::vector<std::vector<std::string>> rows;
  std::istringstream lines(csv);
  for (std::string line; std::getline(lines, line);) {
    rows.emplace_back();
    std::istringstream cells(line);
    for (std::string cell; std::getline(cells, cell, ',');) rows.back().push_back(cell);
  }
  return rows;
}

std::string track_csv(const Workplace& place, const nlohmann::json& result) {
  return place.read(result["run"].get<std::string>() + "/track.csv");
}

TEST(TrackSequence, TracksAFolderOfFramesAndJudgesItself) {
  const Workplace place;
  vision::generated::write_sequence({.seed = 61, .hidden_from = 12, .hidden_frames = 8}, 30, 5,
                                    place.folder());
  const Spoken spoken =
      place.vitreo("run track_sequence --json images=frames training=training truth=truth.csv");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  const auto result = nlohmann::json::parse(spoken.out);
  const auto& results = result["results"];
  EXPECT_EQ(results["frames_judged"], 30);
  EXPECT_EQ(results["wrong"], 0);
  // Three frames must agree before it is believed: two are lost at the begin, and two after it came
  // back.
  EXPECT_LE(results["lost"], 5) << "found again within three frames";
  EXPECT_LT(results["center_error_mean"], 0.5);
  EXPECT_LT(results["major_error_mean"], 2);
  EXPECT_LT(results["minor_error_mean"], 2);
  EXPECT_LT(results["angle_error_mean"], 0.026) << "1.5 degrees, in rad as all of --json";
  EXPECT_GT(results["frames_per_second"], 0);
  const auto rows = rows_of(track_csv(place, result));
  ASSERT_EQ(rows.size(), 31u);
  EXPECT_EQ(rows[0],
            (std::vector<std::string>{"frame", "state", "x_px", "y_px", "major_px", "minor_px",
                                      "angle_deg", "covariance", "microseconds"}));
  EXPECT_EQ(rows[3][1], "tracking");
  std::istringstream covariance(rows[3][7]);
  EXPECT_EQ(std::distance(std::istream_iterator<double>(covariance), {}), 25);
  for (std::size_t k = 13; k <= 20; ++k) {
    EXPECT_NE(rows[k][1], "tracking") << k;
    EXPECT_EQ(rows[k][2], "") << "a place that was not seen is not made up";
  }
  EXPECT_TRUE(
      std::filesystem::exists(place.folder() / result["run"].get<std::string>() / "report.html"));
}

TEST(TrackSequence, GivesHeadingAndTipOfABodyThatWasPointedAt) {
  const Workplace place;
  vision::needle::Scene scene({.seed = 71});
  const auto folder = place.folder();
  std::filesystem::create_directories(folder / "frames");
  std::filesystem::create_directories(folder / "training");
  std::vector<Eigen::Vector2d> tips;
  const auto training = scene.training(8, tips);
  std::string pointed = "name,x_px,y_px\n";
  for (std::size_t k = 0; k < training.size(); ++k) {
    const std::string name = "t" + std::to_string(k);
    cv::imwrite((folder / "training" / (name + ".png")).string(), training[k].image);
    cv::imwrite((folder / "training" / (name + "_mask.png")).string(), training[k].mask);
    pointed += name + "," + std::to_string(tips[k].x()) + "," + std::to_string(tips[k].y()) + "\n";
  }
  place.write("tips.csv", pointed);
  for (int k = 0; k < 8; ++k)
    cv::imwrite((folder / "frames" / ("f" + std::to_string(k) + ".png")).string(),
                scene.frame(k).image);
  const Spoken spoken =
      place.vitreo("run track_sequence --json images=frames training=training tips=tips.csv");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  const auto rows = rows_of(track_csv(place, nlohmann::json::parse(spoken.out)));
  ASSERT_EQ(rows.size(), 9u);
  ASSERT_EQ(rows[0].size(), 14u);
  EXPECT_EQ(rows[0][9], "heading_deg");
  ASSERT_EQ(rows[8].size(), 14u) << "the last frame has a tip";
  const vision::needle::Frame last = scene.frame(7);
  EXPECT_LT(std::abs(std::remainder(std::stod(rows[8][9]) - last.heading * 180 / CV_PI, 360)), 5);
  // px: five times the mean error, as this is one frame
  EXPECT_LT((Eigen::Vector2d(std::stod(rows[8][10]), std::stod(rows[8][11])) - last.tip_px).norm(),
            3);
  place.write("tips.csv", "name,x_px,y_px\nnone,1,2\n");
  const Spoken refused =
      place.vitreo("run track_sequence images=frames training=training tips=tips.csv");
  EXPECT_NE((refused.out + refused.err).find("tips: row 1: no training image has the name none"),
            std::string::npos)
      << refused.out << refused.err;
}

TEST(TrackSequence, TakesATruthThatCountsFromOneAndHasSemiAxes) {
  const Workplace place;
  vision::generated::write_sequence({.seed = 62, .size = {320, 240}}, 4, 4, place.folder());
  auto rows = rows_of(place.read("truth.csv"));
  std::string text = "frame,cx,cy,A,B,phi_deg,visible\n";
  for (std::size_t k = 1; k < rows.size(); ++k)
    text += std::to_string(k) + "," + rows[k][1] + "," + rows[k][2] + "," +
            std::to_string(std::stod(rows[k][3]) / 2) + "," +
            std::to_string(std::stod(rows[k][4]) / 2) + "," + rows[k][5] + ",true\n";
  place.write("semi.csv", text);
  const Spoken spoken = place.vitreo(
      "run track_sequence --json images=frames training=training truth=semi.csv truth_axes=semi");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  const auto result = nlohmann::json::parse(spoken.out);
  EXPECT_EQ(result["results"]["frames_judged"], 4);
  EXPECT_LT(result["results"]["center_error_mean"], 1);
  EXPECT_LT(result["results"]["major_error_mean"], 4);
  EXPECT_EQ(rows_of(track_csv(place, result))[1][0], "1");
}

TEST(TrackSequence, SaysWhatIsMissingOrDamaged) {
  const Workplace place;
  vision::generated::write_sequence({.seed = 63, .size = {320, 240}}, 3, 3, place.folder());
  const auto refused = [&](const std::string& arguments, int exit_code, const std::string& part) {
    const Spoken spoken = place.vitreo("run track_sequence " + arguments);
    EXPECT_EQ(spoken.exit_code, exit_code) << arguments << spoken.out << spoken.err;
    EXPECT_NE((spoken.out + spoken.err).find(part), std::string::npos) << spoken.out << spoken.err;
  };
  refused("images=frames", 2, "training: is missing");
  refused("images=nowhere training=training", 1, "nowhere: there is no such file or folder");
  refused("images=truth.csv training=training", 1, "truth.csv: is not a video that can be read");
  refused("images=frames training=frames", 1, "has no training pair");
  place.write("bad.csv", "frame,cx\n0,1\n");
  refused("images=frames training=training truth=bad.csv", 1, "truth: has no column cy");
  place.write("frames/frame_0001.png", "broken");
  refused("images=frames training=training", 1, "frame_0001.png: is not an image that can be read");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
