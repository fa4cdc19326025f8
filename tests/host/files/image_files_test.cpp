// Pictures in files: in people's order, whole or refused.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/image_files.h"

#include "host/files/video_file.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include <fstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

TEST(ImageFiles, stand_in_the_order_in_which_people_number_them) {
  EXPECT_TRUE(natural_less("frame_2.png", "frame_10.png"));
  EXPECT_TRUE(natural_less("frame_002.png", "frame_10.png"));
  EXPECT_FALSE(natural_less("b_1.png", "a_2.png"));
  EXPECT_TRUE(natural_less("1.png", "01.png") != natural_less("01.png", "1.png"));
  EXPECT_FALSE(natural_less("7.png", "7.png"));
  EXPECT_EQ(number_in("run3_frame_0012.png"), 12);
  EXPECT_EQ(number_in("frame.png"), std::nullopt);
  EXPECT_EQ(number_in("99999999999999999999.png"), std::nullopt);
}

TEST(ImageFiles, of_every_depth_become_8_bit_color_and_masks_keep_their_outline) {
  const TemporaryFolder folder;
  const cv::Mat deep(6, 8, CV_16UC3, cv::Scalar(256 * 10, 256 * 20, 256 * 30));
  cv::imwrite((folder.path() / "deep.png").string(), deep);
  const cv::Mat image = read_color_image(folder.path() / "deep.png");
  ASSERT_EQ(image.type(), CV_8UC3);
  EXPECT_EQ(image.at<cv::Vec3b>(0, 0), cv::Vec3b(10, 20, 30));
  for (const int white : {1, 255}) {
    cv::Mat mask = cv::Mat::zeros(6, 8, CV_8UC1);
    mask(cv::Rect(2, 2, 3, 2)).setTo(white);
    cv::imwrite((folder.path() / "m.png").string(), mask);
    EXPECT_EQ(cv::countNonZero(read_mask(folder.path() / "m.png")), 6);
  }
}

TEST(ImageFiles, that_are_none_or_damaged_are_refused_by_name) {
  const TemporaryFolder folder;
  std::ofstream(folder.path() / "empty.png").close();
  std::ofstream(folder.path() / "text.png") << "no picture";
  cv::imwrite((folder.path() / "whole.png").string(),
              cv::Mat(50, 50, CV_8UC3, cv::Scalar(1, 2, 3)));
  std::filesystem::resize_file(folder.path() / "whole.png", 30);
  for (const char* name : {"missing.png", "empty.png", "text.png", "whole.png"}) {
    try {
      read_color_image(folder.path() / name);
      ADD_FAILURE() << name;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
    }
  }
  EXPECT_THROW(image_files(folder.path() / "nowhere"), std::invalid_argument);
  EXPECT_THROW(VideoFile(folder.path() / "text.png"), std::invalid_argument);
  EXPECT_THROW(VideoFile(folder.path() / "missing.avi"), std::invalid_argument);
}

TEST(ImageFiles, pair_images_with_their_masks) {
  const TemporaryFolder folder;
  const cv::Mat any(5, 5, CV_8UC1, cv::Scalar(9));
  for (const char* name : {"b.png", "a.png", "a_mask.png", "b_mask.png", "alone.png"})
    cv::imwrite((folder.path() / name).string(), any);
  const auto pairs = labeled_files(folder.path());
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs[0].name, "a");
  EXPECT_EQ(image_files(folder.path()).size(), 3u);
  cv::imwrite((folder.path() / "c_mask.png").string(), any);
  EXPECT_THROW(labeled_files(folder.path()), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
