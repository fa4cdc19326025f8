// The level set compared, pixel by pixel, with passes over whole sets of inside pixels.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/level_set_reference.h"

#include "vision/level_set.h"

#include <gtest/gtest.h>

#include <array>
#include <utility>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using namespace level_set_reference;

TEST(LevelSetReference, starts_with_the_pixels_of_the_ellipse_that_are_not_blocked) {
  const Evidence evidence = look(1, 30, 5);
  LevelSet level_set(LevelSetSettings{});
  // The third sticks out of the gate on all sides, the last lies beyond it.
  const std::vector<Ellipse> ellipses{kStart,
                                      {{44.2, 41.6}, 9.3, 2.2, -1.1},
                                      {{47, 38}, 60, 55, 0.3},
                                      {{53.7, 30.2}, 12.6, 12.6, 0},
                                      {{400, 300}, 20, 10, 0.5}};
  for (const Ellipse& ellipse : ellipses) {
    level_set.start(evidence, ellipse);
    const Inside inside(evidence, ellipse);
    expect_same(inside, level_set);
    EXPECT_EQ(level_set.iterations(), 0);
    EXPECT_FALSE(level_set.leaked());
    EXPECT_EQ(inside.count(false) == 0, ellipse.center_px.x() == 400);
  }
}

TEST(LevelSetReference, cycle_one_switches_what_passes_the_thresholds_and_stops_when_nothing_does) {
  int blocked_in_front = 0;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const Evidence evidence = look(seed, 25);
    // The second: both negative, so that what is undecided is against the object; the third: the
    // lower above the higher, where pixels flicker until the passes are used up.
    const std::array<std::pair<int, int>, 3> limits{{{-45, 68}, {-113, -37}, {61, 25}}};
    for (const auto& [low, high] : limits) {
      for (const int iterations : {1, 2, 7, 30}) {
        LevelSet level_set(settings(iterations, 0, 1));
        level_set.start(evidence, kStart);
        Inside inside(evidence, kStart);
        const int passes = evolve(inside, settings(iterations, 0, 1), low, high);
        level_set.evolve(thresholds(low, high));
        expect_same(inside, level_set);
        EXPECT_EQ(level_set.iterations(), passes);
        inside.each([&](int u, int v) {
          blocked_in_front += inside.phi(u, v) == 1 && inside.blocked(u, v);
        });
      }
    }
  }
  EXPECT_GT(blocked_in_front, 200);  // L_out has them, and they never enter
}

TEST(LevelSetReference, a_pixel_at_a_threshold_is_not_switched) {
  Blue blue;
  for (const int level : {-6, 5}) {  // of all pixels: F = level / 16, whatever is summed
    cv::Mat image(80, 100, CV_8UC3, cv::Scalar(static_cast<unsigned char>(level), 0, 0));
    Evidence evidence;
    evidence.look(image, blue, grown(kStart, 6), 400);
    for (const int off : {-1, 0, 1}) {
      LevelSet level_set(settings(1, 0, 1));
      level_set.start(evidence, kStart);
      Inside inside(evidence, kStart);
      const int before = inside.count(false);
      const int at = 9 * level + off;
      level_set.evolve(level > 0 ? thresholds(-500, at) : thresholds(at, 500));
      evolve(inside, settings(1, 0, 1), level > 0 ? -500 : at, level > 0 ? at : 500);
      expect_same(inside, level_set);
      EXPECT_EQ(inside.count(false) != before, off == (level > 0 ? -1 : 1));
    }
  }
}

// Between two values that F can have the threshold is rounded to the nearest: F = 68 / 144 is above
// t_h = 67.68 / 144, but is not switched in.
TEST(LevelSetReference, thresholds_between_two_values_of_F_are_rounded) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const Evidence evidence = look(seed, 25);
    LevelSet level_set(settings(30, 0, 1));
    level_set.start(evidence, kStart);
    level_set.evolve({-0.31, 0.47});
    Inside inside(evidence, kStart);
    evolve(inside, settings(30, 0, 1), -45, 68);
    expect_same(inside, level_set);
  }
}

TEST(LevelSetReference, cycle_two_follows_the_sign_of_the_smoothed_phi) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Evidence evidence = look(seed, 45);  // much noise: a ragged front
    for (const int smoothing : {1, 2, 3, 20}) {
      const LevelSetSettings s = settings(4, smoothing, 1);
      LevelSet level_set(s);
      level_set.start(evidence, kStart);
      level_set.evolve(thresholds(-45, 68));
      Inside inside(evidence, kStart);
      evolve(inside, s, -45, 68);
      expect_same(inside, level_set);
    }
  }
}

TEST(LevelSetReference, rounds_end_when_cycle_one_had_nothing_left_to_move) {
  int single = 0;
  int several = 0;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Evidence evidence = look(seed, 40);
    for (const auto& [iterations, rounds] :
         {std::pair{3, 2}, {3, 5}, {11, 4}, {200, 10}, {30, 2}}) {
      const LevelSetSettings s = settings(iterations, 2, rounds);
      LevelSet level_set(s);
      level_set.start(evidence, kStart);
      level_set.evolve(thresholds(-30, 54));
      Inside inside(evidence, kStart);
      const int passes = evolve(inside, s, -30, 54);
      expect_same(inside, level_set);
      EXPECT_EQ(level_set.iterations(), passes);
      ++(passes < iterations ? single : several);
    }
  }
  EXPECT_GT(single, 4);
  EXPECT_GT(several, 4);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
