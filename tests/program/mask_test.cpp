// vitreo mask: from one outline to a training folder.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/vision/needle_scene.h"
#include "tests/vision/sequence_files.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

TEST(Mask, OneOutlineGivesATrainingFolderThatTracks) {
  const Workplace place;
  vision::generated::SequenceSettings settings{.seed = 65, .size = {320, 240}};
  vision::generated::write_sequence(settings, 4, 1, place.folder());
  vision::generated::Sequence sequence(settings);
  const vision::Ellipse e = sequence.truth(0);
  char outline[200];
  std::snprintf(outline, sizeof outline, "%.1f,%.1f,%.1f,%.1f,%.1f", e.center_px.x() + 2,
                e.center_px.y() - 1, 2 * e.semi_major_px + 2, 2 * e.semi_minor_px + 1,
                e.angle * 57.29578 + 3);
  const std::string command =
      "mask frames/*.png --grab --out made --ellipse=" + std::string(outline);
  const Spoken spoken = place.vitreo(command);
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  for (int k = 0; k < 4; ++k) {
    const std::string name = "frame_000" + std::to_string(k);
    const cv::Mat mask =
        cv::imread((place.folder() / "made" / (name + "_mask.png")).string(), cv::IMREAD_GRAYSCALE);
    const cv::Mat truth = vision::generated::Sequence::mask_of(sequence.truth(k), {320, 240});
    ASSERT_EQ(mask.size(), truth.size()) << name;
    EXPECT_GT(static_cast<double>(cv::countNonZero(mask & truth)) / cv::countNonZero(mask | truth),
              0.88)
        << name;
    EXPECT_TRUE(std::filesystem::exists(place.folder() / "made" / "overlays" / (name + ".png")));
  }
  EXPECT_EQ(place.vitreo("run track_sequence images=frames training=made").exit_code, 0);
  const Spoken again = place.vitreo(command);
  EXPECT_EQ(again.exit_code, 2);
  EXPECT_NE(again.err.find("is there already; --force"), std::string::npos) << again.err;
}

// A needle's point, pointed at in the first image, is in the overlays' folder's tips for the
// others, and `track_sequence` takes the file as it is.
TEST(Mask, OneTipGivesTheTipsOfTheOtherImages) {
  const Workplace place;
  std::filesystem::create_directories(place.folder() / "frames");
  vision::needle::Scene scene({.seed = 64});
  std::vector<vision::needle::Frame> frames;
  for (int k = 0; k < 6; ++k) {
    frames.push_back(scene.frame(17 * k));
    cv::imwrite((place.folder() / "frames" / ("frame_" + std::to_string(k) + ".png")).string(),
                frames.back().image);
  }
  const vision::Ellipse& e = frames[0].truth;
  char words[300];
  std::snprintf(words, sizeof words,
                "mask frames/*.png --grab --out made --ellipse=%.1f,%.1f,%.1f,%.1f,%.1f "
                "--tip=%.1f,%.1f",
                e.center_px.x(), e.center_px.y(), 2 * e.semi_major_px, 2 * e.semi_minor_px,
                e.angle * 57.29578, frames[0].tip_px.x(), frames[0].tip_px.y());
  const Spoken spoken = place.vitreo(words);
  std::ifstream file(place.folder() / "made" / "tips.csv");
  std::string line;
  ASSERT_TRUE(std::getline(file, line)) << spoken.out << spoken.err;
  EXPECT_EQ(line, "name,x_px,y_px");
  int tips = 0;
  for (; std::getline(file, line); ++tips) {
    int k = -1;
    double u = 0, v = 0;
    ASSERT_EQ(std::sscanf(line.c_str(), "frame_%d,%lf,%lf", &k, &u, &v), 3) << line;
    EXPECT_LT((Eigen::Vector2d(u, v) - frames[static_cast<std::size_t>(k)].tip_px).norm(), 4)
        << line;
  }
  EXPECT_GE(tips, 4) << spoken.out;
  EXPECT_EQ(
      place.vitreo("run track_sequence images=frames training=made tips=made/tips.csv").exit_code,
      0);
}

TEST(Mask, SaysWhatIsWrong) {
  const Workplace place;
  vision::generated::write_sequence({.seed = 66, .size = {320, 240}}, 1, 1, place.folder());
  const auto refused = [&](const std::string& words, const std::string& part) {
    const Spoken spoken = place.vitreo("mask " + words);
    EXPECT_EQ(spoken.exit_code, 2) << words;
    EXPECT_NE((spoken.out + spoken.err).find(part), std::string::npos) << words << "\n"
                                                                       << spoken.out << spoken.err;
  };
  refused("frames/frame_0000.png", "wants --ellipse or --polygon");
  refused("frames/frame_0000.png --ellipse=1,2,3", "--ellipse: wants cx,cy,A,B,phi");
  refused("frames/frame_0000.png --ellipse=1,2,3,4,x", "--ellipse: wants cx,cy,A,B,phi");
  refused("frames/frame_0000.png --ellipse=90,90,60,30,0 --tip=1", "--tip: wants x,y");
  refused("frames/frame_0000.png --ellipse=90,90,60,30,0 --tip=90,95",
          "tip: is no end of the body");
  refused("frames/frame_0000.png --polygon=1,2,3,4", "--polygon: wants");
  refused("frames/frame_0000.png --ellipse=900,900,9,9,0", "no pixel of the image lies inside");
  refused("nowhere.png --ellipse=9,9,9,9,0", "nowhere.png: there is no such file");
  refused("truth.csv --ellipse=9,9,9,9,0", "truth.csv: is not an image");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
