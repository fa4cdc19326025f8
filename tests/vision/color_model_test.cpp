// SPDX-License-Identifier: Apache-2.0
#include "vision/color_model.h"

#include "tests/vision/sequence_generator.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <string>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

// A disc of one gray on a ground of another, each with a spread: what (8.1) gives is known.
LabeledImage disc(double object, double ground, double sigma, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0, sigma);
  LabeledImage one{cv::Mat(120, 160, CV_8UC3), cv::Mat::zeros(120, 160, CV_8UC1)};
  cv::circle(one.mask, {80, 60}, 25, cv::Scalar(255), cv::FILLED);
  for (int v = 0; v < 120; ++v) {
    for (int u = 0; u < 160; ++u) {
      const double level = one.mask.at<unsigned char>(v, u) != 0 ? object : ground;
      for (int c = 0; c < 3; ++c)
        one.image.at<cv::Vec3b>(v, u)[c] = cv::saturate_cast<unsigned char>(level + noise(random));
    }
  }
  return one;
}

TEST(ColorSpace, reads_back_every_name_that_it_writes) {
  std::set<std::string> names;
  for (const Channels& channels : all_pairs()) {
    EXPECT_EQ(channels_of(name_of(channels)), channels);
    names.insert(name_of(channels));
  }
  EXPECT_EQ(names.size(), 18U);  // table 8.2 has six rows of three
  EXPECT_EQ(channels_of("RGB"), (Channels{ColorSpace::rgb, ChannelSet::all}));
  EXPECT_THROW(channels_of("RX"), std::invalid_argument);
}

TEST(ColorSpace, keeps_every_channel_between_nought_and_one) {
  for (const Channels& channels : all_pairs()) {
    for (int k = 0; k < 27; ++k) {
      for (const double value :
           convert(channels.space, k % 3 / 2.0, k / 3 % 3 / 2.0, k / 9 / 2.0)) {
        EXPECT_GE(value, -1e-3);  // the published matrices have three or four digits
        EXPECT_LE(value, 1 + 1e-3);
      }
    }
  }
}

TEST(ColorModel, has_the_quality_that_the_overlap_of_the_histograms_gives) {
  // Two normal laws 2 sigma apart, cut between: 84.1 % right on each side, so r = 4 x 0.841 - 2
  // = 1.365 by (8.1). One channel pair of independent noise: sqrt 2 times the distance, 92.1 %, r
  // = 1.685.
  const std::vector<LabeledImage> images{disc(110, 130, 10, 1), disc(110, 130, 10, 2)};
  ColorModelSettings settings;
  settings.channels = channels_of("RG");
  const Quality quality = ColorModel::train(images, settings).quality();
  EXPECT_NEAR(quality.mean, 1.685,
              0.1);  // bins of 8 gray levels, 2000 object pixels, and the ground's greater number
  EXPECT_EQ(quality.of_image.size(), 2U);
}

TEST(ColorModel, ranks_all_pairs_and_knows_that_gray_noise_has_no_hue) {
  const std::vector<LabeledImage> images{disc(80, 160, 6, 3)};
  const auto ranks = ColorModel::rank(images, {});
  ASSERT_EQ(ranks.size(), 18U);
  for (const ChannelRank& rank : ranks) {
    const std::string name = name_of(rank.channels);
    if (name == "nRnG" || name == "UV") {
      EXPECT_LT(rank.quality.mean, 1.5) << name;
    } else if (name == "RG") {
      EXPECT_GT(rank.quality.mean, 1.95);  // 13 sigma apart: all but the rounding
    }
  }
}

TEST(ColorModel, opens_a_gap_of_thresholds_only_by_weights) {
  const std::vector<LabeledImage> images{disc(118, 130, 12, 1), disc(118, 130, 12, 2)};
  ColorModelSettings settings;
  settings.channels = channels_of("RG");
  const ColorModel model = ColorModel::train(images, settings);
  EXPECT_LE(model.flat_thresholds().low, model.flat_thresholds().high);
  // As (8.2) stands its optimum is one threshold; its flat part is narrow where the histograms
  // overlap.
  EXPECT_LT(model.flat_thresholds().high - model.flat_thresholds().low, 1);
  EXPECT_GT(model.weighted_thresholds().high - model.weighted_thresholds().low,
            model.flat_thresholds().high - model.flat_thresholds().low);
}

TEST(ColorModel, says_nothing_of_colors_that_it_never_saw) {
  const ColorModel model = ColorModel::train(std::vector{disc(110, 130, 5, 1)}, {});
  EXPECT_EQ(model.table()[ColorModel::cell_of(255, 0, 255)], 0);
  EXPECT_GT(model.table()[ColorModel::cell_of(110, 110, 110)], 0);
  EXPECT_LT(model.table()[ColorModel::cell_of(134, 134, 134)], 0);
}

TEST(ColorModel, comes_back_from_its_bytes_and_refuses_damaged_ones) {
  const ColorModel model = ColorModel::train(std::vector{disc(110, 130, 5, 1)}, {});
  const std::string bytes = model.save();
  const ColorModel back = ColorModel::load(bytes);
  EXPECT_EQ(back.table(), model.table());
  EXPECT_EQ(back.flat_thresholds(), model.flat_thresholds());
  EXPECT_EQ(back.channels(), model.channels());
  EXPECT_EQ(back.save(), bytes);
  for (std::size_t k = 0; k < bytes.size(); k += 4099) {
    std::string damaged = bytes;
    damaged[k] = static_cast<char>(damaged[k] ^ 1);
    EXPECT_THROW(ColorModel::load(damaged), std::invalid_argument) << k;
    EXPECT_THROW(ColorModel::load(bytes.substr(0, k)), std::invalid_argument) << k;
  }
  EXPECT_THROW(ColorModel::load(bytes + "x"), std::invalid_argument);
  EXPECT_THROW(ColorModel::load(""), std::invalid_argument);
}

TEST(ColorModel, names_the_image_that_it_can_not_learn_from) {
  const LabeledImage good = disc(110, 130, 5, 1);
  const auto expect_refused = [&](LabeledImage bad, const std::string& why) {
    try {
      ColorModel::train(std::vector{good, bad}, {});
      ADD_FAILURE() << "took an image where " << why;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find("image 2"), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
  };
  expect_refused({good.image, cv::Mat::zeros(120, 160, CV_8UC1)}, "mask is empty");
  expect_refused({good.image, cv::Mat::ones(120, 160, CV_8UC1)}, "mask fills");
  expect_refused({good.image, cv::Mat::ones(60, 160, CV_8UC1)}, "another size");
  expect_refused({good.mask, good.mask}, "8-bit color");
  expect_refused({good.image, good.image}, "8-bit gray");
  EXPECT_THROW(ColorModel::train({}, {}), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
