// Reference for the level set's tests: passes over whole sets of inside pixels, and its pictures.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/level_set.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <tuple>
#include <utility>
#include <vector>

namespace vitreo::vision::level_set_reference {

/// F from the blue channel as signed bytes, in steps of 1/16.
class Blue : public EvidenceSource {
 public:
  void prepare(const cv::Mat&, const cv::Rect&) override {}
  void read(const cv::Mat& image, int v, int u, int step, int count,
            std::int8_t* to) const override {
    for (int i = 0; i < count; ++i)
      to[i] = static_cast<std::int8_t>(image.at<cv::Vec3b>(v, u + i * step)[0]);
  }
  void set_light(const LogColor&) override {}
};

/// Some blobs for and against the object, and noise.
inline cv::Mat picture(unsigned seed, double noise) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> share(0, 1);
  std::vector<std::array<double, 4>> blobs;
  for (int i = 0; i < 8; ++i) {
    const double u = 20 + share(random) * 60;
    const double v = 15 + share(random) * 50;
    const double wide = 4 + share(random) * 8;
    blobs.push_back({u, v, wide, share(random) < 0.6 ? 60.0 : -60.0});
  }
  cv::Mat image(80, 100, CV_8UC3, cv::Scalar(0, 0, 0));
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      double f = -15 + noise * normal(random);
      for (const auto& [bu, bv, wide, high] : blobs)
        f += high * std::exp(-(std::pow(u - bu, 2) + std::pow(v - bv, 2)) / (2 * wide * wide));
      const auto level = static_cast<std::int8_t>(std::clamp(std::round(f), -127.0, 127.0));
      image.at<cv::Vec3b>(v, u)[0] = static_cast<unsigned char>(level);
    }
  }
  return image;
}

inline const Ellipse kStart{{47.3, 38.8}, 17.2, 11.4, 0.6};

/// A quarter of the image belongs to another object, a strip to this one.
inline Evidence look(unsigned seed, double noise, double grow_px = 12) {
  const cv::Mat image = picture(seed, noise);
  cv::Mat owned(image.size(), CV_8UC1, cv::Scalar(0));
  owned(cv::Rect(52, 0, 48, 30)) = 2;
  owned(cv::Rect(30, 40, 30, 3)) = 7;
  Blue blue;
  Evidence evidence;
  evidence.look(image, blue, grown(kStart, grow_px), 400, owned, 7);
  return evidence;
}

/// Keeps which pixels are inside and derives phi from it; no lists, nothing carried along.
class Inside {
 public:
  Inside(const Evidence& evidence, const Ellipse& ellipse)
      : evidence_(evidence), box_(evidence.region()), in_(static_cast<std::size_t>(box_.area())) {
    const double c = std::cos(ellipse.angle);
    const double s = std::sin(ellipse.angle);
    each([&](int u, int v) {
      const double x = u - ellipse.center_px.x();
      const double y = v - ellipse.center_px.y();
      const double along = (c * x + s * y) / ellipse.semi_major_px;
      const double across = (c * y - s * x) / ellipse.semi_minor_px;
      in_[evidence_.index_of(u, v)] = along * along + across * across <= 1 && !blocked(u, v);
    });
  }
  template <class F>
  void each(F f) const {
    for (int v = box_.y; v < box_.y + box_.height; ++v)
      for (int u = box_.x; u < box_.x + box_.width; ++u) f(u, v);
  }
  bool blocked(int u, int v) const { return evidence_.at(u, v) == Evidence::kBlocked; }
  bool has(int u, int v) const {
    return box_.contains(cv::Point(u, v)) && in_[evidence_.index_of(u, v)] != 0;
  }
  int phi(int u, int v) const {
    const bool here = has(u, v);
    const bool front = has(u - 1, v) != here || has(u + 1, v) != here || has(u, v - 1) != here ||
                       has(u, v + 1) != here;
    return (here ? -1 : 1) * (front ? 1 : 3);
  }
  /// Those of L_out that enter together, then those of the new L_in that leave together.
  template <class Enters, class Leaves>
  bool pass(Enters enters, Leaves leaves) {
    std::vector<std::size_t> entered;
    each([&](int u, int v) {
      if (phi(u, v) == 1 && !blocked(u, v) && enters(u, v))
        entered.push_back(evidence_.index_of(u, v));
    });
    for (const std::size_t p : entered) in_[p] = 1;
    std::vector<std::size_t> left;
    each([&](int u, int v) {
      if (phi(u, v) == -1 && leaves(u, v)) left.push_back(evidence_.index_of(u, v));
    });
    for (const std::size_t p : left) in_[p] = 0;
    return !entered.empty() || !left.empty();
  }
  /// Thresholds in units of Evidence::kScale.
  bool data_pass(int low, int high) {
    return pass([&](int u, int v) { return evidence_.at(u, v) > high; },
                [&](int u, int v) { return evidence_.at(u, v) < low; });
  }
  bool smooth_pass() {
    return pass([&](int u, int v) { return smoothed(u, v) < 0; },
                [&](int u, int v) { return smoothed(u, v) > 0; });
  }
  bool prior_pass(const PlacedShape& prior) {
    return pass([&](int u, int v) { return prior.at(u, v) < 0; },
                [&](int u, int v) { return prior.at(u, v) > 0; });
  }
  int count(bool of_front) const {
    int count = 0;
    each([&](int u, int v) { count += of_front ? std::abs(phi(u, v)) == 1 : has(u, v); });
    return count;
  }
  /// Its 4-connected parts, by relabeling until nothing changes.
  std::vector<std::vector<cv::Point>> parts() const {
    std::vector<int> label(in_.size());
    each([&](int u, int v) {
      const std::size_t p = evidence_.index_of(u, v);
      label[p] = in_[p] != 0 ? static_cast<int>(p) + 1 : 0;
    });
    for (bool changed = true; changed;) {
      changed = false;
      each([&](int u, int v) {
        if (!has(u, v)) return;
        int& mine = label[evidence_.index_of(u, v)];
        for (const auto& [du, dv] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
          if (!has(u + du, v + dv)) continue;
          const int other = label[evidence_.index_of(u + du, v + dv)];
          if (other > mine) mine = other, changed = true;
        }
      });
    }
    std::vector<std::vector<cv::Point>> parts(in_.size() + 1);
    each([&](int u, int v) {
      const int mine = label[evidence_.index_of(u, v)];
      if (mine > 0) parts[static_cast<std::size_t>(mine)].push_back({u, v});
    });
    std::erase_if(parts, [](const auto& part) { return part.empty(); });
    std::ranges::sort(parts, [](const auto& a, const auto& b) { return a.size() > b.size(); });
    return parts;
  }
  void keep(const std::vector<cv::Point>& part) {
    std::ranges::fill(in_, 0);
    for (const cv::Point& p : part) in_[evidence_.index_of(p.x, p.y)] = 1;
  }

 private:
  int smoothed(int u, int v) const {
    static constexpr std::array<int, 5> kWeights{1, 3, 4, 3, 1};
    int sum = 0;
    for (int j = 0; j < 5; ++j)
      for (int i = 0; i < 5; ++i) sum += kWeights[i] * kWeights[j] * phi(u + i - 2, v + j - 2);
    return sum;
  }
  const Evidence& evidence_;
  cv::Rect box_;
  std::vector<char> in_;
};

/// phi, and where the front's points are.
inline void expect_same(const Inside& inside, const LevelSet& level_set) {
  using Point = std::tuple<float, float, float>;
  std::vector<Point> wanted;
  int wrong = 0;
  inside.each([&](int u, int v) {
    const int phi = inside.phi(u, v);
    wrong += level_set.phi(u, v) != phi;
    if (std::abs(phi) == 1)
      wanted.emplace_back(static_cast<float>(u), static_cast<float>(v), phi < 0 ? -0.5F : 0.5F);
  });
  EXPECT_EQ(wrong, 0);
  std::vector<FrontPoint> points(3, FrontPoint{-7, -8, 9});  // what was in the vector goes
  level_set.front(points);
  std::vector<Point> found;
  for (const FrontPoint& p : points) found.emplace_back(p.u, p.v, p.distance);
  std::ranges::sort(wanted);
  std::ranges::sort(found);
  EXPECT_EQ(found, wanted);
}

inline LevelSetSettings settings(int iterations, int smoothing, int rounds) {
  LevelSetSettings s;
  s.iterations = iterations;
  s.smoothing = smoothing;
  s.rounds = rounds;
  return s;
}

inline Thresholds thresholds(int low, int high) {
  return {low / Evidence::kScale, high / Evidence::kScale};
}

/// Cycles one and two; the number of passes of cycle one, with the one that moved nothing.
inline int evolve(Inside& inside, const LevelSetSettings& s, int low, int high) {
  int passes = 0;
  bool moving = true;
  for (int round = 0; round < s.rounds && moving; ++round) {
    for (int i = 0; i < s.iterations && moving; ++i, ++passes) moving = inside.data_pass(low, high);
    for (int i = 0; i < s.smoothing; ++i) inside.smooth_pass();
  }
  return passes;
}

}  // namespace vitreo::vision::level_set_reference
