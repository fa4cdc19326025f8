// Learned evidence: what networks known in closed form add to F, and the trained network of
// scripts/networks in a tracker, before grounds and seeds that its training had not.
// SPDX-License-Identifier: Apache-2.0
#include "vision/learned_evidence.h"

#include "tests/vision/onnx_writer.h"
#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"

#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <fstream>
#include <sstream>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

// Object dark, ground bright.
ColorModel two_grays() {
  cv::Mat image(120, 160, CV_8UC3, cv::Scalar::all(150));
  cv::Mat mask = cv::Mat::zeros(image.size(), CV_8UC1);
  cv::circle(mask, {80, 60}, 25, 255, cv::FILLED);
  image.setTo(cv::Scalar::all(60), mask);
  const std::vector<LabeledImage> images{{image, mask}};
  return ColorModel::train(images, {});
}

int read_at(const EvidenceSource& source, const cv::Mat& image, int u, int v) {
  std::int8_t f = 0;
  source.read(image, v, u, 1, 1, &f);
  return f;
}

// A picture in which each pixel is another color.
cv::Mat ramp() {
  cv::Mat image(120, 160, CV_8UC3);
  for (int v = 0; v < image.rows; ++v)
    for (int u = 0; u < image.cols; ++u)
      image.at<cv::Vec3b>(v, u) =
          cv::Vec3b(static_cast<unsigned char>(u), static_cast<unsigned char>(v), 60);
  return image;
}

TEST(LearnedEvidence, adds_what_the_network_says_to_the_F_of_the_colors) {
  const ColorModel colors = two_grays();
  ColorEvidence alone(colors);
  LearnedEvidence source(colors, onnx::convolution({0, 0, 0, 0}, 1.5));
  const cv::Mat image = ramp();
  for (const cv::Rect region : {cv::Rect(40, 30, 50, 40), cv::Rect(-10, -10, 60, 50)}) {
    source.prepare(image, region);
    for (const cv::Point at : {cv::Point(45, 35), cv::Point(48, 38)})
      EXPECT_EQ(read_at(source, image, at.x, at.y),
                std::min(read_at(alone, image, at.x, at.y) + 24, 127))
          << at;
  }
}

TEST(LearnedEvidence, the_network_sees_levels_in_the_light_of_the_training) {
  const ColorModel colors = two_grays();
  LearnedEvidence source(colors, onnx::convolution({0, 0, 4, 0}, 0));
  const cv::Mat image(120, 160, CV_8UC3, cv::Scalar(0, 0, 51));
  const cv::Rect region(40, 30, 50, 40);
  ColorEvidence alone(colors);
  source.prepare(image, region);
  EXPECT_EQ(read_at(source, image, 60, 50) - read_at(alone, image, 60, 50), 13);  // 16 4 51/255
  const LogColor halved = LogColor::Constant(-std::log(2));
  source.set_light(halved);
  alone.set_light(halved);
  source.prepare(image, region);
  EXPECT_EQ(read_at(source, image, 60, 50) - read_at(alone, image, 60, 50), 26);
}

// 0.5 of F / 8, of the mean of the pixels beside: F grows by 16 / 16 of itself / 16.
TEST(LearnedEvidence, a_whole_image_and_a_region_of_it_give_the_same_on_an_even_ground) {
  const ColorModel colors = two_grays();
  cv::Mat image(480, 640, CV_8UC3, cv::Scalar::all(150));
  ColorEvidence alone(colors);
  LearnedEvidence source(colors, onnx::convolution({0, 0, 0, 2}, 0));
  const int f = read_at(alone, image, 5, 5);
  ASSERT_LT(f, -20);
  const int expected = std::max(f + static_cast<int>(std::lround(16 * 2 * f / 128.0)), -127);
  source.prepare(image, {{0, 0}, image.size()});
  for (const cv::Point at : {cv::Point(0, 0), cv::Point(639, 479), cv::Point(320, 240)})
    EXPECT_EQ(read_at(source, image, at.x, at.y), expected) << at;
  source.prepare(image, {600, 440, 60, 60});  // sticks out
  EXPECT_EQ(read_at(source, image, 639, 479), expected);
}

TEST(LearnedEvidence, refuses_what_is_no_network_and_one_of_other_shapes) {
  const auto said = [](const std::string& bytes) -> std::string {
    try {
      LearnedEvidence::check(bytes);
      return "nothing";
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
  };
  EXPECT_EQ(said(onnx::convolution({1, 1, 1, 1}, 0)), "nothing");
  EXPECT_EQ(said(""), "network: must be an ONNX file of at most 2 MB");
  EXPECT_EQ(said(std::string(3'000'000, 'x')), "network: must be an ONNX file of at most 2 MB");
  EXPECT_EQ(said("no network"), "network: is no ONNX file that can be run");
  EXPECT_EQ(said(onnx::convolution({1, 1, 1, 1}, 0, 1)),
            "network: its shapes are not those of learned evidence");
}

std::string trained_network() {
  std::ostringstream bytes;
  bytes << std::ifstream(VITREO_NETWORK, std::ios::binary).rdbuf();
  return bytes.str();
}

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

struct Tracked {
  int lost = 0;
  int wrong = 0;
  double off_px = 0;
  double seconds = 0;
};

Tracked track(generated::Sequence& sequence, const ObjectModel& model, int frames) {
  ColorTracker tracker(model, {});
  Tracked sum;
  for (int k = 0; k < frames; ++k) {
    const generated::Frame frame = sequence.frame(k);
    const double start = cpu_seconds();
    const Track seen = tracker.update(frame.image);
    sum.seconds += (cpu_seconds() - start) / frames;
    if (!seen.measured) {
      sum.lost += k > 2;
      continue;
    }
    const double off = (seen.measured->ellipse.center_px - frame.truth.center_px).norm();
    sum.wrong += off > 5;
    sum.off_px += off / frames;
  }
  return sum;
}

// Goals of the whole: 60 frames a second of one core, weights below 2 MB.
TEST(LearnedEvidence, the_trained_network_tracks_before_vessels_of_the_robots_gray_at_camera_rate) {
  cv::setNumThreads(1);
  const std::string network = trained_network();
  ASSERT_LT(network.size(), 2'000'000U);
  generated::Sequence sequence({.seed = 9341, .dark_vessels = true});
  const ObjectModel model = ObjectModel::train(sequence.training(8), {}, {}, network);
  const Tracked found = track(sequence, model, 60);
  EXPECT_LE(found.lost, 3) << "one frame in twenty";
  EXPECT_EQ(found.wrong, 0);
  EXPECT_LT(found.off_px, 1.1);  // the goal that colors alone have before this ground
  EXPECT_LT(found.seconds, 1.0 / 60);
  RecordProperty("frames_a_second", static_cast<int>(1 / found.seconds));
}

TEST(LearnedEvidence, is_a_part_of_the_saved_model) {
  generated::Sequence sequence({.seed = 9342});
  const std::string network = onnx::convolution({0, 0, 0, 0.5}, 0.25);
  const ObjectModel model = ObjectModel::train(sequence.training(3), {}, {}, network);
  const ObjectModel loaded = ObjectModel::load(model.save());
  EXPECT_EQ(loaded.network, network);
  EXPECT_EQ(loaded.thresholds(), model.thresholds());
  EXPECT_NE(model.thresholds(), model.color.weighted_thresholds());
  const Tracked before = track(sequence, model, 12);
  const Tracked after = track(sequence, loaded, 12);
  EXPECT_EQ(before.lost, after.lost);
  EXPECT_EQ(before.off_px, after.off_px);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
