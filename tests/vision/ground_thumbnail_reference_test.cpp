// Ground thumbnail against grounds drawn by another hand, displaced by what is known, and against
// what must not be taken for a displacement: lamps, reflexes, tools, bodies, patterns that repeat.
// SPDX-License-Identifier: Apache-2.0
#include "vision/ground_thumbnail.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using Eigen::Vector2d;
using Lamp = std::function<double(double, double)>;  // of (u, v) in a 640 x 480 image
constexpr int kMargin = 220;                         // of a ground around the view in its middle
constexpr double kFifth = 0.2, kWrong = 0.5;         // cells: the header's claim, and what is a lie
const cv::Size kUsual(640, 480);
const Vector2d kNone(0, 0);

cv::Mat octaves(cv::RNG& random, const std::vector<std::pair<int, double>>& of) {
  const cv::Size size(640 + 2 * kMargin, 480 + 2 * kMargin);
  cv::Mat sum(size, CV_32FC1, cv::Scalar(110)), one;
  for (const auto& [pitch, deviation] : of) {
    cv::Mat coarse(size.height / pitch + 3, size.width / pitch + 3, CV_32FC1);
    random.fill(coarse, cv::RNG::NORMAL, 0, deviation);
    cv::resize(coarse, one, size, 0, 0, cv::INTER_CUBIC);
    sum += one;
  }
  return sum;
}

// Darkens along a bent line.
void vessel(cv::Mat& ground, cv::RNG& random, cv::Point2f from, float heading, int thickness) {
  cv::Mat line(ground.size(), CV_32FC1, cv::Scalar(0));
  for (int k = 0; k < 30; ++k) {
    heading += static_cast<float>(random.gaussian(0.15));
    const cv::Point2f to = from + 20 * cv::Point2f(std::cos(heading), std::sin(heading));
    cv::line(line, from, to, cv::Scalar(40), thickness);
    from = to;
  }
  ground -= line;
}

enum class Kind { mottled, vessels, fundus, even_scale, coarse };
const std::vector<Kind> kSharp{Kind::mottled, Kind::vessels, Kind::fundus, Kind::even_scale};

cv::Mat ground(Kind kind, std::uint64_t seed) {
  cv::RNG random(seed);
  if (kind == Kind::even_scale) return octaves(random, {{35, 14}});
  if (kind == Kind::coarse) return octaves(random, {{150, 14}, {70, 10}});
  if (kind == Kind::mottled) return octaves(random, {{120, 9}, {50, 9}, {22, 7}, {9, 4}});
  cv::Mat drawn = octaves(random, {{90, 5}, {25, 4}});
  const auto w = static_cast<float>(drawn.cols), h = static_cast<float>(drawn.rows);
  const cv::Point2f disc(0.42F * w, 0.47F * h);
  for (int k = 0; k < 18; ++k) {
    const float heading = random.uniform(0.0F, 6.28F);
    const cv::Point2f free(random.uniform(0.0F, w), random.uniform(0.0F, h));
    vessel(drawn, random, kind == Kind::fundus ? disc : free, heading, 3 + k % 8);
  }
  if (kind == Kind::fundus) cv::circle(drawn, disc, 45, cv::Scalar(185), cv::FILLED);
  cv::GaussianBlur(drawn, drawn, {}, 1.5);
  return drawn;
}

// Green levels of a view: what a view of shift 0 has at p is at center + turn (p - center) + shift.
cv::Mat view(const cv::Mat& of, const Vector2d& shift_px, const cv::Size& size = kUsual,
             const Eigen::Matrix2d& turn = Eigen::Matrix2d::Identity()) {
  const Vector2d scale(640.0 / size.width, 480.0 / size.height);
  const Vector2d center((size.width - 1) / 2.0, (size.height - 1) / 2.0);
  const Eigen::Matrix2d back = scale.asDiagonal() * turn.inverse();
  const Vector2d at = Vector2d(319.5 + kMargin, 239.5 + kMargin) - back * (center + shift_px);
  const cv::Mat map =
      (cv::Mat_<double>(2, 3) << back(0, 0), back(0, 1), at.x(), back(1, 0), back(1, 1), at.y());
  cv::Mat seen;
  cv::warpAffine(of, seen, map, size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REFLECT);
  return seen;
}

cv::Mat colored(const cv::Mat& green, const cv::Mat& others) {
  cv::Mat image;
  cv::merge(std::vector<cv::Mat>{0.5 * others + 10, green, 1.1 * others + 20}, image);
  image.convertTo(image, CV_8U);
  return image;
}
GroundThumbnail thumbnail(const cv::Mat& green) { return GroundThumbnail(colored(green, green)); }

cv::Mat lit(const cv::Mat& green, const Lamp& lamp) {
  cv::Mat out = green.clone();
  for (int v = 0; v < out.rows; ++v)
    for (int u = 0; u < out.cols; ++u) out.at<float>(v, u) *= static_cast<float>(lamp(u, v));
  return out;
}

cv::Mat noisy(const cv::Mat& green, double deviation, std::uint64_t seed) {
  cv::RNG random(seed);
  cv::Mat noise(green.size(), CV_32FC1);
  random.fill(noise, cv::RNG::NORMAL, 0, deviation);
  return green + noise;
}

double gone(double u, double v, double u0, double v0, double scale) {
  return ((u - u0) * (u - u0) + (v - v0) * (v - v0)) / (scale * scale);
}
double vignette(double u, double v) { return 1 - 0.8 * gone(u, v, 320, 240, 400); }  // corners: 0.2
double spot(double u, double v) { return 1 + 0.8 * std::exp(-gone(u, v, 400, 180, 170)); }

struct Tally {
  int exact = 0, right = 0, wrong = 0, nothing = 0;
  double worst = 0, squares = 0;  // cells
  void add(const std::optional<Vector2d>& said, const Vector2d& truth,
           const Vector2d& cell_px = {10, 10}) {
    const Vector2d cells = (said.value_or(truth) - truth).cwiseQuotient(cell_px);
    const double off = cells.cwiseAbs().maxCoeff();
    worst = std::max(worst, off);
    squares += cells.squaredNorm() / 2;
    ++(!said ? nothing : (off > kWrong ? wrong : right));
    exact += said && off <= kFifth;
  }
  int asked() const { return right + wrong + nothing; }
  double rms() const { return std::sqrt(squares / std::max(right + wrong, 1)); }
};
std::ostream& operator<<(std::ostream& out, const Tally& t) {
  return out << t.right << " right, " << t.wrong << " wrong, worst " << t.worst << " cells";
}
const Vector2d kShifts[] = {{23.7, -41.3}, {-87.5, 64.2}, {-5.4, 3.1}, {42, 81.6}, {-112, -66}};
using Change = std::function<cv::Mat(const cv::Mat&, int)>;  // of a view, in trial k

// All grounds by all shifts, each view changed as told; trial 0 is the view that all are held to.
Tally tally(std::uint64_t seed, const std::vector<Kind>& kinds, const Change& earlier,
            const Change& later, double moved = 1) {
  Tally result;
  for (const Kind kind : kinds) {
    const cv::Mat of = ground(kind, ++seed);
    const GroundThumbnail first = thumbnail(earlier(view(of, kNone), 0));
    for (int k = 0; k < 5; ++k) {
      const Vector2d shift = moved * kShifts[k];
      result.add(first.shift_to(thumbnail(later(view(of, shift), k + 1))), shift);
    }
  }
  return result;
}
Tally tally(std::uint64_t seed, const Change& both) { return tally(seed, kSharp, both, both); }
cv::Mat as_it_is(const cv::Mat& green, int) { return green; }
cv::Mat in_vignette(const cv::Mat& green, int) { return lit(green, vignette); }
Change drawing(const std::function<void(cv::Mat&, int)>& draw) {
  return [=](const cv::Mat& green, int k) {
    cv::Mat out = green.clone();
    draw(out, k);
    return out;
  };
}
const Change kReflexes = drawing([](cv::Mat& seen, int) {
  for (int k = 0; k < 9; ++k)
    cv::circle(seen, {50 + 67 * k, 60 + 173 * k % 370}, 5 + 2 * k, 400, cv::FILLED);
  cv::GaussianBlur(seen, seen, {}, 1);
});

void expect_exact(const Tally& t) { EXPECT_EQ(t.exact, t.asked()) << t; }
// What may silence it but not make it lie.
void expect_not_wrong(const Tally& t, double found = 0) {
  EXPECT_EQ(t.wrong, 0) << t;
  EXPECT_GE(t.right, found * t.asked()) << t;
}
// What must not trouble it: a fifth of a cell in the mean, and seldom silent.
void expect_good(const Tally& t) {
  expect_not_wrong(t, 0.85);
  EXPECT_LE(t.rms(), kFifth) << t;
}

TEST(GroundThumbnail, finds_the_displacement_of_a_ground_with_structure_of_many_sizes) {
  expect_exact(tally(100, {Kind::mottled, Kind::even_scale}, as_it_is, as_it_is));
  for (const std::uint64_t seed : {110U, 120U, 130U}) expect_good(tally(seed, as_it_is));
}

// One row is read in each cell, and a vessel is thinner than that.
TEST(GroundThumbnail, is_good_to_less_than_half_a_cell_where_vessels_are_what_there_is_to_see) {
  for (const std::uint64_t seed : {140U, 150U, 160U, 170U}) {
    const Tally t = tally(seed, {Kind::vessels, Kind::fundus}, as_it_is, as_it_is);
    EXPECT_LE(t.rms(), kFifth) << t;
    EXPECT_LT(t.worst, 0.5) << t;
  }
}

TEST(GroundThumbnail, is_right_or_silent_where_the_ground_is_smooth) {
  for (const std::uint64_t seed : {180U, 185U, 190U})
    for (const Change& change : {Change(as_it_is), Change(in_vignette), kReflexes})
      expect_not_wrong(tally(seed, {Kind::coarse}, change, change));
}

TEST(GroundThumbnail, finds_what_was_displaced_by_its_whole_reach_in_every_direction) {
  Tally t;
  const cv::Mat of = ground(Kind::mottled, 200);
  const GroundThumbnail first = thumbnail(view(of, kNone));
  for (const double far : {120.0, 119.5, 114.9, 7.3})
    for (int k = 0; k < 9; ++k) {
      const Vector2d shift(far * (k % 3 - 1), far * (k / 3 - 1));  // one of them: none
      t.add(first.shift_to(thumbnail(view(of, shift))), shift);
    }
  expect_exact(t);
}

TEST(GroundThumbnail, finds_odd_and_even_numbers_of_cells_alike) {
  Tally odd, others;  // odd: along both axes
  for (const Kind kind : kSharp) {
    const cv::Mat of = ground(kind, 250);
    const GroundThumbnail first = thumbnail(view(of, kNone));
    for (const int u : {-5, -4, 3, 8})
      for (const int v : {-6, -3, 2, 7}) {
        const Vector2d shift(10.0 * u, 10.0 * v);
        ((u & v & 1) != 0 ? odd : others).add(first.shift_to(thumbnail(view(of, shift))), shift);
      }
  }
  expect_good(others);
  expect_good(odd);
}

// At most 12 cells, give or take a fifth.
TEST(GroundThumbnail, says_nothing_of_a_displacement_beyond_its_reach) {
  const double beyond[][2] = {{131, 0}, {-127, 20}, {10, 131}, {0, -150}, {-137, -137}};
  for (const Kind kind : kSharp) {
    const cv::Mat of = ground(kind, 300);
    const GroundThumbnail first = thumbnail(view(of, kNone));
    for (const auto& [u, v] : beyond)
      if (const auto said = first.shift_to(thumbnail(view(of, {u, v})))) {
        EXPECT_LE(said->cwiseAbs().maxCoeff(), 122) << u << ' ' << v;
      }
  }
}

TEST(GroundThumbnail, measures_in_pixels_of_the_image_whatever_its_size) {
  const cv::Mat of = ground(Kind::mottled, 400);
  const int sizes[][2] = {{656, 490}, {1280, 960}, {320, 240}, {517, 391}, {720, 300}};
  for (const auto& [width, height] : sizes) {
    const cv::Size size(width, height);
    Tally t;
    const Vector2d cell_px(size.width / 64.0, size.height / 48.0);
    const GroundThumbnail first = thumbnail(view(of, {0, 0}, size));
    for (const Vector2d& usual : kShifts) {
      const Vector2d shift = usual.cwiseProduct(cell_px) / 10;
      const GroundThumbnail later = thumbnail(view(of, shift, size));
      t.add(first.shift_to(later), shift, cell_px);
      t.add(later.shift_to(first), -shift, cell_px);
    }
    SCOPED_TRACE(size.width);
    expect_exact(t);
  }
}

TEST(GroundThumbnail, sees_green_only) {
  const cv::Mat of = ground(Kind::mottled, 600),
                stranger = view(ground(Kind::mottled, 601), {0, 0});
  const cv::Mat later = view(of, {-37, 22});
  const GroundThumbnail first = thumbnail(view(of, kNone));
  const auto said = first.shift_to(GroundThumbnail(colored(later, stranger)));
  EXPECT_LT((said.value() - Vector2d(-37, 22)).norm(), 2);
  EXPECT_FALSE(first.shift_to(GroundThumbnail(colored(stranger, later))));
}

TEST(GroundThumbnail, reads_a_part_of_a_larger_image_and_lives_through_a_tiny_one) {
  const cv::Mat green = ground(Kind::mottled, 610), whole = colored(green, green);
  const auto part = [&](const cv::Rect& at) { return GroundThumbnail(whole(at)); };
  const auto said = part({31, 17, 640, 480}).shift_to(part({81, 3, 640, 480}));
  EXPECT_LT((said.value() - Vector2d(-50, 14)).norm(), 2);
  for (const int size : {1, 2, 47, 64})
    EXPECT_LT(part({9, 9, size, size}).shift_to(part({9, 9, size, size})).value_or(kNone).norm(),
              1);
}

TEST(GroundThumbnail, says_nothing_where_there_is_no_structure_or_only_noise) {
  const GroundThumbnail full = thumbnail(view(ground(Kind::mottled, 700), {0, 0}));
  std::vector<GroundThumbnail> empty(1);
  const cv::Mat gray(480, 640, CV_32FC1, cv::Scalar(100));
  for (const double level : {0.0, 0.01, 0.9, 2.54, 2.55}) empty.push_back(thumbnail(level * gray));
  const std::size_t blank = empty.size();
  for (const double deviation : {1.0, 3.0, 8.0, 40.0})
    for (int k = 0; k < 3; ++k) empty.push_back(thumbnail(noisy(gray, deviation, empty.size())));
  for (std::size_t k = 0; k < empty.size(); ++k) {
    EXPECT_FALSE(empty[k].shift_to(full)) << k;
    EXPECT_FALSE(full.shift_to(empty[k])) << k;
    for (std::size_t j = 0; j < empty.size(); ++j)
      if (j != k || k < blank) {
        EXPECT_FALSE(empty[k].shift_to(empty[j])) << k << ' ' << j;
      }
  }
}

TEST(GroundThumbnail, does_not_take_the_lamp_on_a_ground_without_structure_for_structure) {
  for (const Lamp& lamp : {Lamp(vignette), Lamp(spot)})
    for (const double share : {0.25, 0.6, 1.0}) {
      const auto part = [&](double u, double v) { return 100 + 100 * share * (lamp(u, v) - 1); };
      const cv::Mat seen = lit(cv::Mat::ones(480, 640, CV_32FC1), part);
      EXPECT_FALSE(thumbnail(seen).shift_to(thumbnail(0.9 * seen))) << share;
      EXPECT_FALSE(thumbnail(noisy(seen, 2, 1)).shift_to(thumbnail(noisy(seen, 2, 2)))) << share;
    }
}

// Also where all that belongs to the camera is the same: vignette, spot, reflexes.
TEST(GroundThumbnail, says_nothing_of_two_views_of_other_grounds) {
  for (const bool same_camera : {false, true}) {
    std::vector<GroundThumbnail> views;
    for (std::uint64_t k = 0; k < 16; ++k) {
      cv::Mat seen = view(ground(kSharp[k % 4], 800 + k), {0, 0});
      if (same_camera) seen = kReflexes(lit(lit(seen, vignette), spot), 0);
      views.push_back(thumbnail(seen));
    }
    for (std::size_t k = 0; k < views.size(); ++k)
      for (std::size_t j = 0; j < views.size(); ++j)
        if (j != k) {
          EXPECT_FALSE(views[k].shift_to(views[j])) << same_camera << k << ' ' << j;
        }
  }
}

// A second displacement fits as well, be it along the stripes or by a period.
TEST(GroundThumbnail, says_nothing_of_patterns_that_repeat_within_its_reach) {
  for (const double period : {23.0, 57.0, 100.0})
    for (const double turn : {0.0, 0.5, std::numbers::pi / 2})
      for (const int kind : {0, 1, 2}) {  // stripes, squares, what repeats along one axis only
        const auto pattern = [&](double u, double v) {
          const double x = std::cos(turn) * u + std::sin(turn) * v;
          const double y = std::cos(turn) * v - std::sin(turn) * u;
          const double a = std::sin(kind == 2 ? x * x / 7000 : 2 * std::numbers::pi * x / period);
          const double b = std::sin(2 * std::numbers::pi * y / period);
          return 110 + 90 * std::clamp(kind == 0 ? a : 3 * a * b, -1.0, 1.0);
        };
        const cv::Mat plain = cv::Mat::ones(480, 640, CV_32FC1);
        const auto moved = [&](double u, double v) { return pattern(u - 7, v + 4); };
        const GroundThumbnail first = thumbnail(noisy(lit(plain, pattern), 2, 1));
        EXPECT_FALSE(first.shift_to(thumbnail(noisy(lit(plain, moved), 2, 2))))
            << period << ' ' << turn << ' ' << kind;
      }
}

TEST(GroundThumbnail, does_not_count_lamp_vignette_spot_of_light_nor_white_reflexes) {
  const Change spotted = [](const cv::Mat& green, int) { return lit(green, spot); };
  const Change dim = drawing([](cv::Mat& seen, int) { seen *= 0.3; });
  const Change bent = drawing([](cv::Mat& seen, int) { cv::pow(seen * 10, 0.7, seen); });
  expect_good(tally(1000, in_vignette));
  expect_good(tally(1100, spotted));
  expect_good(tally(1200, kSharp, as_it_is, dim));
  expect_good(tally(1300, kSharp, in_vignette, spotted));
  expect_good(tally(1400, kSharp, as_it_is, bent));
  expect_good(tally(1500, kReflexes));
}

// An ellipse twice as long as wide; where it moves it is elsewhere in every trial.
Change with_body(float semi_major, double level, bool moves) {
  return drawing([=](cv::Mat& seen, int k) {
    const auto moved = static_cast<float>(moves ? k : 0);
    const cv::Point2f at(300.F + 21.F * moved, 260.F - 14.F * moved);
    cv::ellipse(seen, {at, {2 * semi_major, semi_major}, 30}, cv::Scalar(level), cv::FILLED);
  });
}

TEST(GroundThumbnail, is_not_misled_by_a_robot_or_a_large_tool_that_moves_or_stays_alone) {
  const Change moving = with_body(30, 50, true), staying = with_body(30, 50, false);
  expect_good(tally(1600, kSharp, moving, moving, 0));
  for (const Change& body : {moving, staying}) expect_not_wrong(tally(1610, body), 0.5);
  const Change tool = drawing([](cv::Mat& seen, int) {  // a quarter of the image
    cv::rectangle(seen, {400, 120}, {639, 439}, cv::Scalar(88), cv::FILLED);
  });
  expect_not_wrong(tally(1800, kSharp, as_it_is, tool), 0.7);
  expect_not_wrong(tally(1900, tool), 0.3);
}

TEST(GroundThumbnail, is_not_taken_along_by_a_large_bright_body_that_moves_or_stays_alone) {
  const Change moving = with_body(60, 240, true), staying = with_body(60, 240, false);
  expect_not_wrong(tally(1700, kSharp, moving, moving, 0));
  for (const Change& body : {moving, staying}) expect_not_wrong(tally(1710, body));
}

TEST(GroundThumbnail, sees_through_noise_and_defocus) {
  for (const double deviation : {3.0, 8.0})
    expect_good(tally(2000, [&](const cv::Mat& green, int k) {
      return noisy(green, deviation, 31 + static_cast<std::uint64_t>(k));
    }));
  const Change blurred = drawing([](cv::Mat& seen, int) { cv::GaussianBlur(seen, seen, {}, 4); });
  expect_good(tally(2100, blurred));
  expect_good(tally(2200, kSharp, as_it_is, blurred));
}

// The displacement is not the same everywhere then: what is said is that of the middle of what both
// views show. At the views' edges it is a cell more or less, so some may be refused.
TEST(GroundThumbnail, finds_the_displacement_of_the_middle_beside_a_small_turn_and_zoom) {
  Tally t;
  for (const Kind kind : kSharp) {
    const cv::Mat of = ground(kind, 2300);
    const GroundThumbnail first = thumbnail(view(of, kNone));
    for (int k = 0; k < 4; ++k) {
      const double angle = (k % 2 == 0 ? 2 : -2) * std::numbers::pi / 180;
      const Eigen::Matrix2d turn = (k < 2 ? 1.03 : 0.97) * Eigen::Rotation2Dd(angle).matrix();
      const Vector2d& s = kShifts[k];
      t.add(first.shift_to(thumbnail(view(of, s, kUsual, turn))), s - (turn * s - s) / 2);
    }
  }
  expect_not_wrong(t, 0.5);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
