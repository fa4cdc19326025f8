// The retina map: frames of a moving view found again at camera rate, after jumps, with a robot
// before them and reflexes fixed to the sensor; other places are not taken for it.
// SPDX-License-Identifier: Apache-2.0
#include "vision/retina_map.h"

#include "tests/vision/retina.h"
#include "vision/retina_picture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using synthetic::picture_from_view;
using synthetic::view_of;

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

struct Walk {
  std::uint64_t seed = 1;
  int frames = 60;
  double reach = 130;  // px, of the way
  double jump = 0;     // px, at frames 20 and 40
  bool reflexes = false;
  bool robot = false;
};

struct WalkScore {
  int found = 0;
  int wrong = 0;  // beyond 3 px
  double rms = 0;
  double worst = 0;
  double claimed = 0;  // rms of sigma
  double seconds = 0;  // mean
  double longest = 0;
  int map_frames = 0;
};

WalkScore walk(const Walk& chosen) {
  const cv::Mat picture = synthetic::retina({1600, 1200}, chosen.seed);
  std::mt19937_64 random(chosen.seed);
  RetinaMap map;
  WalkScore score;
  const auto at = [&](int k) {
    const double t = 0.06 * k;
    Eigen::Vector2d place(800 + chosen.reach * std::sin(t),
                          600 + 0.7 * chosen.reach * std::sin(1.6 * t));
    if (k >= 20 && k < 40) place.x() += chosen.jump;
    return picture_from_view(place, 0.03 * std::sin(0.9 * t));
  };
  double squares = 0;
  double claims = 0;
  const Eigen::Affine2d first = at(0);
  for (int k = 0; k < chosen.frames; ++k) {
    cv::Mat view = view_of(picture, at(k), {}, random);
    std::vector<Ellipse> bodies;
    if (chosen.reflexes)
      for (const cv::Point& spot : {cv::Point(180, 150), cv::Point(450, 120), cv::Point(330, 360)})
        cv::circle(view, spot, 16, cv::Scalar(255), cv::FILLED, cv::LINE_AA);
    if (chosen.robot) {
      const Ellipse body{{320 + 3.0 * k, 200 + 1.0 * k}, 30, 15, 0.05 * k};
      cv::ellipse(view,
                  cv::RotatedRect({static_cast<float>(body.center_px.x()),
                                   static_cast<float>(body.center_px.y())},
                                  {60, 30}, static_cast<float>(body.angle * 180 / M_PI)),
                  cv::Scalar(40), cv::FILLED, cv::LINE_AA);
      bodies.push_back(body);
    }
    const double start = cpu_seconds();
    const auto pose = map.update(view, bodies);
    const double took = cpu_seconds() - start;
    score.seconds += took / chosen.frames;
    score.longest = std::max(score.longest, took);
    if (!pose) continue;
    ++score.found;
    const Eigen::Affine2d true_map_from_image = first.inverse() * at(k);
    double off = 0;
    for (const double u : {100.0, 320.0, 540.0})
      for (const double v : {80.0, 240.0, 400.0})
        off += ((pose->map_from_image * Eigen::Vector2d(u, v)) -
                (true_map_from_image * Eigen::Vector2d(u, v)))
                   .squaredNorm() /
               9;
    squares += off;
    claims += 2 * pose->sigma_px * pose->sigma_px;
    score.worst = std::max(score.worst, std::sqrt(off));
    score.wrong += off > 9;
  }
  score.map_frames = map.frames();
  score.rms = std::sqrt(squares / std::max(score.found, 1));
  score.claimed = std::sqrt(claims / std::max(score.found, 1));
  std::printf(
      "reach %.0f jump %.0f reflexes %d robot %d: found %d of %d, wrong %d, rms %.2f px (claimed "
      "%.2f), worst %.2f, %.1f ms, longest %.1f ms, map of %d\n",
      chosen.reach, chosen.jump, chosen.reflexes, chosen.robot, score.found, chosen.frames,
      score.wrong, score.rms, score.claimed, score.worst, 1e3 * score.seconds, 1e3 * score.longest,
      score.map_frames);
  return score;
}

TEST(RetinaMap, FindsEveryFrameOfAMovingViewToHalfAPixel) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const WalkScore score = walk({.seed = seed});
    EXPECT_EQ(score.found, 60);
    EXPECT_EQ(score.wrong, 0);
    EXPECT_LT(score.rms, 0.5);
  }
}

TEST(RetinaMap, FindsTheViewAgainAfterAJump) {
  for (const std::uint64_t seed : {4, 5}) {
    const WalkScore score = walk({.seed = seed, .jump = 60});
    EXPECT_EQ(score.found, 60);
    EXPECT_EQ(score.wrong, 0);
    EXPECT_LT(score.rms, 0.5);
  }
}

TEST(RetinaMap, ReflexesThatStayInTheSensorsFrameDoNotHoldIt) {
  const WalkScore score = walk({.seed = 6, .reflexes = true});
  EXPECT_GE(score.found, 58);
  EXPECT_EQ(score.wrong, 0);
  EXPECT_LT(score.rms, 0.5);
}

TEST(RetinaMap, ARobotBeforeItIsNoRetina) {
  const WalkScore score = walk({.seed = 7, .robot = true});
  EXPECT_EQ(score.found, 60);
  EXPECT_EQ(score.wrong, 0);
  EXPECT_LT(score.rms, 0.5);
}

TEST(RetinaMap, GrowsOverARetinaThreeViewsWide) {
  const WalkScore score = walk({.seed = 8, .frames = 110, .reach = 420});
  EXPECT_GE(score.found, 108);
  EXPECT_EQ(score.wrong, 0);
  EXPECT_GE(score.map_frames, 4);
  EXPECT_LT(score.rms, 1.0) << "along a chain of frames";
}

TEST(RetinaMap, AnotherRetinaIsNotFoundOnIt) {
  std::mt19937_64 random(9);
  RetinaMap map;
  const cv::Mat here = synthetic::retina({1600, 1200}, 11);
  const cv::Mat elsewhere = synthetic::retina({1600, 1200}, 12);
  const auto view = [&](const cv::Mat& picture, double u) {
    return view_of(picture, picture_from_view({u, 600}, 0), {}, random);
  };
  ASSERT_TRUE(map.update(view(here, 800)));
  for (int k = 0; k < 10; ++k) EXPECT_FALSE(map.update(view(elsewhere, 700 + 20 * k))) << k;
  EXPECT_TRUE(map.update(view(here, 810))) << "and the own one again";
  EXPECT_FALSE(map.update(cv::Mat(480, 640, CV_8UC1, cv::Scalar(90)))) << "nothing to see";
  EXPECT_THROW(map.update(cv::Mat(240, 320, CV_8UC1, cv::Scalar(90))), std::invalid_argument);
}

TEST(RetinaMap, ItsPictureIsThatOfTheRetina) {
  const cv::Mat picture = synthetic::retina({1600, 1200}, 13);
  std::mt19937_64 random(13);
  RetinaMap map;
  RetinaPicture made;
  EXPECT_TRUE(made.image().empty());
  const Eigen::Affine2d first = picture_from_view({700, 600}, 0);
  // Mean of what is shown from what is there, gray levels, in the frame of the first view.
  const auto off = [&](const cv::Mat& image, const Eigen::Vector2d& origin, int right) {
    double sum = 0;
    int count = 0;
    for (int v = 100; v < 400; v += 7)
      for (int u = 100; u < right; u += 7) {
        const Eigen::Vector2d in_picture = first * Eigen::Vector2d(u, v);
        const double truth = picture.at<float>(static_cast<int>(std::lround(in_picture.y())),
                                               static_cast<int>(std::lround(in_picture.x())));
        const double shown = image.at<unsigned char>(static_cast<int>(std::lround(v + origin.y())),
                                                     static_cast<int>(std::lround(u + origin.x())));
        sum += std::abs(shown - truth);
        ++count;
      }
    return sum / count;
  };
  double one_view = 0;
  for (int k = 0; k < 30; ++k) {
    const cv::Mat view =
        view_of(picture, picture_from_view({700.0 + 12 * k, 600}, 0), {.vignette = 0}, random);
    if (k == 0) one_view = off(view, {0, 0}, 600);
    const auto pose = map.update(view);
    ASSERT_TRUE(pose) << k;
    if (pose->grew) made.add(view, pose->map_from_image);
  }
  const cv::Mat image = made.image();
  EXPECT_GE(image.cols, 640 + 12 * 29 / 2) << "half of the way at least made it grow";
  const Eigen::Vector2d origin = made.pixel_of({0, 0});
  EXPECT_LT(off(image, origin, 600), one_view) << "views together are no worse than one";
  EXPECT_LT(off(image, origin, 800), 1.2 * one_view) << "nor is what no single view shows";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
