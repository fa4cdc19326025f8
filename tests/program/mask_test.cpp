// vitreo mask: from one outline to a training folder.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/vision/sequence_files.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace {

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
  refused("frames/frame_0000.png --polygon=1,2,3,4", "--polygon: wants");
  refused("frames/frame_0000.png --ellipse=900,900,9,9,0", "no pixel of the image lies inside");
  refused("nowhere.png --ellipse=9,9,9,9,0", "nowhere.png: there is no such file");
  refused("truth.csv --ellipse=9,9,9,9,0", "truth.csv: is not an image");
}

}  // namespace
}  // namespace vitreo
