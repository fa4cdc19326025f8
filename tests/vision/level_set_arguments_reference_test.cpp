// The level set's third cycle, its largest part, leaks, memory and settings, against plain sets.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/level_set_reference.h"
#include "vision/level_set.h"
#include "vision/shape_model.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using namespace level_set_reference;

/// Eggs of several shapes, turned.
ShapeModel eggs() {
  std::vector<cv::Mat> masks;
  for (const double blunt : {0.1, 0.25, 0.4, 0.55}) {
    cv::Mat mask(90, 110, CV_8UC1, cv::Scalar(0));
    for (int v = 0; v < mask.rows; ++v) {
      for (int u = 0; u < mask.cols; ++u) {
        const double turn = 0.4 + blunt;
        const double x = (std::cos(turn) * (u - 52) + std::sin(turn) * (v - 44)) / (26 + 8 * blunt);
        const double y = (std::cos(turn) * (v - 44) - std::sin(turn) * (u - 52)) / 15;
        if (x * x + y * y * (1 + blunt * x) < 1) mask.at<unsigned char>(v, u) = 255;
      }
    }
    masks.push_back(mask);
  }
  return ShapeModel::train(masks);
}

LevelSetSettings of_prior(int passes, int max_points = 4096) {
  LevelSetSettings s = settings(4, 1, 1);
  s.prior_iterations = passes;
  s.max_points = max_points;
  return s;
}

TEST(LevelSetReference, cycle_three_is_table_8_1_line_by_line) {
  const ShapeModel model = eggs();
  int moved = 0;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Evidence evidence = look(seed, 30);
    // Beside the start, larger and turned; the second sticks out of the gate and into what is owned
    // by another.
    for (const Eigen::Vector2d& center : {Eigen::Vector2d(42.6, 43.1), {58.4, 31.7}}) {
      const ShapeFit fit{{center, -0.7 + seed, 15.4 + seed}, {0.8, -0.5, 0.3, 0.2}};
      const PlacedShape prior(model, fit);
      for (const int passes : {0, 1, 2, 3, 50}) {
        LevelSet level_set(of_prior(passes));
        level_set.start(evidence, kStart);
        level_set.evolve(thresholds(-45, 68));
        const int iterations = level_set.iterations();
        level_set.evolve_to_prior(prior);
        Inside inside(evidence, kStart);
        evolve(inside, of_prior(passes), -45, 68);
        for (int i = 0; i < passes; ++i) moved += inside.prior_pass(prior);
        expect_same(inside, level_set);
        EXPECT_FALSE(level_set.leaked());
        EXPECT_EQ(level_set.iterations(), iterations);
        if (passes < 50) continue;
        int wrong = 0;  // converged: what is not blocked coincides with the prior
        inside.each([&](int u, int v) {
          wrong += inside.has(u, v) && prior.at(u, v) > 0;
          wrong += inside.phi(u, v) == 1 && prior.at(u, v) < 0 && !inside.blocked(u, v);
        });
        EXPECT_EQ(wrong, 0);
      }
    }
  }
  EXPECT_GT(moved, 50);
}

TEST(LevelSetReference, keeps_the_largest_part_with_its_moments_and_mean_evidence) {
  int several = 0;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    const Evidence evidence = look(seed, 50);
    const LevelSetSettings s = settings(12, seed % 2 == 0 ? 0 : 1, 1);
    LevelSet level_set(s);
    level_set.start(evidence, kStart);
    level_set.evolve(thresholds(-20, 40));
    const int iterations = level_set.iterations();
    Inside inside(evidence, kStart);
    evolve(inside, s, -20, 40);
    const auto parts = inside.parts();
    ASSERT_TRUE(parts.size() == 1 || parts[0].size() > parts[1].size());  // else either may stay
    several += parts.size() > 3;
    const Segment segment = level_set.keep_largest();
    inside.keep(parts[0]);
    expect_same(inside, level_set);
    EXPECT_EQ(level_set.iterations(), iterations);

    const auto count = static_cast<double>(parts[0].size());
    EXPECT_EQ(segment.area_px, count);
    Eigen::Vector2d center(0, 0);
    double evidence_sum = 0;
    for (const cv::Point& p : parts[0]) {
      center += Eigen::Vector2d(p.x, p.y) / count;
      evidence_sum += evidence.at(p.x, p.y);
    }
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
    for (const cv::Point& p : parts[0]) {
      const Eigen::Vector2d from = Eigen::Vector2d(p.x, p.y) - center;
      covariance += from * from.transpose() / count;
    }
    EXPECT_NEAR((segment.ellipse.center_px - center).norm(), 0, 1e-10);
    // A filled ellipse of shape S has the covariance S S / 4.
    const Eigen::Matrix2d shape = segment.ellipse.shape();
    EXPECT_NEAR((shape * shape - 4 * covariance).norm(), 0, 1e-9 * covariance.norm());
    EXPECT_GE(segment.ellipse.semi_major_px, segment.ellipse.semi_minor_px);
    EXPECT_NEAR(segment.evidence, evidence_sum / count / Evidence::kScale, 1e-12);

    // What is left evolves on from there.
    level_set.evolve(thresholds(-90, 10));
    evolve(inside, s, -90, 10);
    expect_same(inside, level_set);
    const Segment again = level_set.keep_largest();
    inside.keep(inside.parts()[0]);
    expect_same(inside, level_set);
    EXPECT_EQ(again.area_px, inside.count(false));
  }
  EXPECT_GT(several, 3);
}

// Grains: most of the pixels belong to others at random, so that parts have all shapes and many
// touch at their corners alone, which does not join them.
TEST(LevelSetReference, parts_are_joined_along_sides_and_not_at_corners) {
  int judged = 0;
  for (unsigned seed = 1; seed <= 24; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const double taken = 0.3 + 0.02 * (seed % 12);
    const cv::Mat image = picture(seed, 20);
    cv::Mat owned(image.size(), CV_8UC1, cv::Scalar(0));
    for (int v = 0; v < owned.rows; ++v)
      for (int u = 0; u < owned.cols; ++u)
        if (std::uniform_real_distribution<double>(0, 1)(random) < taken)
          owned.at<unsigned char>(v, u) = 2;
    Blue blue;
    Evidence evidence;
    evidence.look(image, blue, grown(kStart, 6), 400, owned, 7);
    LevelSet level_set(LevelSetSettings{});
    level_set.start(evidence, kStart);
    Inside inside(evidence, kStart);
    expect_same(inside, level_set);
    const auto parts = inside.parts();
    ASSERT_GT(parts.size(), 3U);
    if (parts[0].size() == parts[1].size()) continue;  // either may stay
    ++judged;
    const Segment segment = level_set.keep_largest();
    EXPECT_EQ(segment.area_px, static_cast<double>(parts[0].size()));
    double sum = 0;
    for (const cv::Point& p : parts[0]) sum += evidence.at(p.x, p.y);
    EXPECT_NEAR(segment.evidence, sum / static_cast<double>(parts[0].size()) / Evidence::kScale,
                1e-12);
    inside.keep(parts[0]);
    expect_same(inside, level_set);
  }
  EXPECT_GT(judged, 12);
}

// Bars of one row each, and one of two rows: as many parts as bars, whatever their runs are.
TEST(LevelSetReference, bars_of_a_row_are_parts_too) {
  using Bars = std::vector<cv::Rect>;
  const std::vector<Bars> cases{{{40, 36, 9, 1}},
                                {{40, 34, 5, 1}, {44, 38, 9, 1}, {41, 42, 3, 1}},
                                {{40, 34, 8, 2}, {44, 38, 9, 1}},
                                {{40, 34, 3, 2}, {44, 38, 9, 1}}};
  for (const Bars& bars : cases) {
    cv::Mat owned(80, 100, CV_8UC1, cv::Scalar(2));
    for (const cv::Rect& bar : bars) owned(bar) = 0;
    Blue blue;
    Evidence evidence;
    evidence.look(picture(5, 20), blue, grown(kStart, 6), 400, owned, 7);
    LevelSet level_set(LevelSetSettings{});
    level_set.start(evidence, kStart);
    Inside inside(evidence, kStart);
    const auto parts = inside.parts();
    ASSERT_EQ(parts.size(), bars.size());
    EXPECT_EQ(level_set.keep_largest().area_px, static_cast<double>(parts[0].size()));
    inside.keep(parts[0]);
    expect_same(inside, level_set);
  }
}

TEST(LevelSetReference, nothing_inside_is_a_segment_of_no_area) {
  const Evidence evidence = look(3, 20);
  LevelSet level_set(settings(60, 3, 2));
  level_set.start(evidence, {{400, 300}, 20, 10, 0.5});
  EXPECT_EQ(level_set.keep_largest().area_px, 0);
  level_set.start(evidence, kStart);
  level_set.evolve(thresholds(5000, 6000));  // everything leaves, from the rim inwards
  const Segment none = level_set.keep_largest();
  EXPECT_EQ(none.area_px, 0);
  EXPECT_EQ(none.evidence, 0);
  Inside inside(evidence, kStart);
  inside.keep({});
  expect_same(inside, level_set);
  EXPECT_FALSE(level_set.leaked());
}

TEST(LevelSetReference, a_front_longer_than_allowed_stops_the_evolution_after_that_pass) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    const Evidence evidence = look(seed, 25);
    Inside longer(evidence, kStart);
    const int at_start = longer.count(true);
    for (int pass = 0; pass < 6; ++pass) longer.data_pass(-45, 68);
    for (const int limit : {at_start, longer.count(true) - 1, longer.count(true)}) {
      LevelSetSettings s = settings(30, 3, 3);
      s.max_points = limit;
      LevelSet level_set(s);
      level_set.start(evidence, kStart);
      EXPECT_FALSE(level_set.leaked());
      level_set.evolve(thresholds(-45, 68));
      Inside inside(evidence, kStart);
      int passes = 0;
      while (inside.count(true) <= limit && passes < 30) inside.data_pass(-45, 68), ++passes;
      ASSERT_LT(passes, 30);
      EXPECT_TRUE(level_set.leaked());
      EXPECT_EQ(level_set.iterations(), passes);
      expect_same(inside, level_set);  // and no cycle two
      level_set.evolve(thresholds(-45, 68));
      EXPECT_TRUE(level_set.leaked());
      expect_same(inside, level_set);
      level_set.start(evidence, kStart);  // forgets it
      EXPECT_FALSE(level_set.leaked());
      EXPECT_EQ(level_set.iterations(), 0);
      expect_same(Inside(evidence, kStart), level_set);
    }
    LevelSetSettings s = settings(30, 3, 3);
    s.max_points = at_start - 1;
    LevelSet level_set(s);
    level_set.start(evidence, kStart);
    EXPECT_TRUE(level_set.leaked());
    level_set.evolve(thresholds(-45, 68));
    EXPECT_EQ(level_set.iterations(), 0);
    expect_same(Inside(evidence, kStart), level_set);
  }
}

TEST(LevelSetReference, cycle_three_stops_at_a_leak_too) {
  const ShapeModel model = eggs();
  const Evidence evidence = look(2, 30);
  const PlacedShape prior(model, {{{45.2, 40.3}, 0.5, 24}, {0.4, 0.3, -0.2, 0.1}});
  Inside inside(evidence, kStart);
  inside.prior_pass(prior);
  inside.prior_pass(prior);
  const int limit = inside.count(true) - 1;
  LevelSet level_set(of_prior(20, limit));
  level_set.start(evidence, kStart);
  level_set.evolve_to_prior(prior);
  EXPECT_TRUE(level_set.leaked());
  expect_same(inside, level_set);
}

TEST(LevelSetReference, remembers_nothing_of_what_it_was_used_for_before) {
  const LevelSetSettings s = settings(9, 2, 2);
  LevelSet level_set(s);
  level_set.reserve(200);
  for (const auto& [seed, grow] : {std::pair{1U, 12.0}, {2U, 2.0}, {3U, 20.0}, {4U, 7.0}}) {
    const Evidence evidence = look(seed, 35, grow);  // the region's size and stride change
    for (const Ellipse& start : {kStart, Ellipse{{44, 36}, 8.5, 5.1, -0.9}}) {
      level_set.start(evidence, start);
      Inside inside(evidence, start);
      expect_same(inside, level_set);
      level_set.evolve(thresholds(-27, 49));
      EXPECT_EQ(level_set.iterations(), evolve(inside, s, -27, 49));
      expect_same(inside, level_set);
      level_set.keep_largest();
    }
  }
}

TEST(LevelSetReference, settings_are_refused_by_name) {
  using Member = int LevelSetSettings::*;
  struct Bound {
    Member member;
    int low;
    int high;
    const char* message;
  };
  constexpr int kMost = std::numeric_limits<int>::max();
  constexpr int kLeast = std::numeric_limits<int>::min();
  for (const Bound& bound : std::vector<Bound>{
           {&LevelSetSettings::iterations, 1, 200, "iterations: must be 1 to 200"},
           {&LevelSetSettings::smoothing, 0, 20, "smoothing: must be 0 to 20"},
           {&LevelSetSettings::rounds, 1, 10, "rounds: must be 1 to 10"},
           {&LevelSetSettings::prior_iterations, 0, 50, "prior_iterations: must be 0 to 50"},
           {&LevelSetSettings::max_points, 64, 1000000, "max_points: must be 64 to 1000000"}}) {
    LevelSetSettings s;
    for (const int allowed : {bound.low, bound.low + 1, bound.high - 1, bound.high}) {
      s.*bound.member = allowed;
      EXPECT_NO_THROW(s.check()) << bound.message << ", " << allowed;
      if (allowed < 10000) {
        EXPECT_NO_THROW(LevelSet{s}) << bound.message << ", " << allowed;
      }
    }
    for (const int refused : {kLeast, bound.low - 1, bound.high + 1, kMost}) {
      s.*bound.member = refused;
      for (const bool by_check : {true, false}) {
        try {
          if (by_check) s.check();
          if (!by_check) LevelSet{s};
          FAIL() << bound.message << ", " << refused;
        } catch (const std::invalid_argument& error) {
          EXPECT_EQ(std::string(error.what()), bound.message);
        }
      }
    }
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
