// WallWatch against its header's words, told by the whole history of sights each time anew.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/wall_watch.h"

#include "control/clearance.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;

constexpr double kMargin = 0.3e-3;  // m

/// The header's words over all sights since the last goal.
class Reference {
 public:
  WallWatch::Verdict see(const WallSight& s) {
    seen_.push_back(s);
    return {inside(), pressed(), lying()};
  }
  void forget() { seen_.clear(); }

 private:
  double bound(const WallSight& s) const {
    return std::min(s.clearance.retina.distance - s.clearance.retina.uncertainty,
                    s.clearance.lens.distance - s.clearance.lens.uncertainty);
  }
  bool lens(const WallSight& s) const {
    return s.clearance.lens.distance - s.clearance.lens.uncertainty <
           s.clearance.retina.distance - s.clearance.retina.uncertainty;
  }
  /// Longer than `kBriefly` below the margin by the hysteresis it is inside, and then until it is
  /// at the margin. What was before the first sight is not known, so it counts as outside.
  bool inside() const {
    bool in = false;
    double outside = seen_.front().time;
    for (const WallSight& s : seen_) {
      if (bound(s) >= kMargin - (in ? 0 : WallWatch::kHysteresis)) outside = s.time;
      in = s.time - outside >= WallWatch::kBriefly;
    }
    return in;
  }
  bool told_nearer(const WallSight& s) const {
    const control::WallClearance& wall = lens(s) ? s.clearance.lens : s.clearance.retina;
    return !s.kept_out && wall.distance < WallWatch::kNear &&
           wall.normal.dot(s.position - s.target) > WallWatch::kError;
  }
  /// In the shortest span of `kLong` and more up to now every sight is of one wall and told nearer,
  /// and from its begin to its end the robot has come nearer by less than `kStill`.
  bool pressed() const {
    const WallSight& now = seen_.back();
    const Vector3d& normal = lens(now) ? now.clearance.lens.normal : now.clearance.retina.normal;
    for (auto s = seen_.rbegin(); s != seen_.rend(); ++s) {
      if (lens(*s) != lens(now) || !told_nearer(*s)) return false;
      if (now.time - s->time < WallWatch::kLong) continue;
      return normal.dot(s->position - now.position) < WallWatch::kStill;
    }
    return false;
  }
  bool lying() const {
    for (auto s = seen_.rbegin(); s != seen_.rend(); ++s) {
      const double distance = lens(*s) ? s->clearance.lens.distance : s->clearance.retina.distance;
      if (distance > WallWatch::kTouches) return seen_.back().time - s->time >= WallWatch::kLies;
    }
    return seen_.back().time - seen_.front().time >= WallWatch::kLies;
  }
  std::vector<WallSight> seen_;
};

/// A narrow eye, so that both walls are met: the robot rests, creeps and leaps between them.
class Patient {
 public:
  explicit Patient(unsigned seed) : random_(seed) {
    retina_ = Vector3d(from_to(-0.5, 0.5), from_to(-0.5, 0.5), 1).normalized();
    lens_ = -Vector3d(from_to(-0.5, 0.5), from_to(-0.5, 0.5), 1).normalized();
  }
  double from_to(double low, double high) {
    return low + (high - low) * (static_cast<double>(random_()) / 4294967296.0);
  }
  bool one_in(unsigned count) { return random_() % count == 0; }
  WallSight next() {
    time_ += one_in(40) ? from_to(0.1, 2) : from_to(0.03, 0.1);
    if (one_in(60)) begin_a_stretch();
    if (one_in(50)) off_ += from_to(-0.3e-3, 0.3e-3);
    off_ += pace_ * from_to(0, 2e-6) + from_to(-0.5e-6, 0.5e-6);
    WallSight s;
    s.time = time_;
    s.position = off_ * retina_ + Vector3d(1e-3, -2e-3, 0.5e-3);
    s.target = s.position + error_ + Vector3d(from_to(-1, 1), from_to(-1, 1), 0) * 2e-6;
    s.clearance.retina = {off_, retina_, doubt_};
    s.clearance.lens = {2e-3 - off_, lens_, 0.5 * doubt_};
    s.kept_out = one_in(often_kept_out_);
    return s;
  }

 private:
  void begin_a_stretch() {
    const double starts[] = {0, 10e-6, 0.3e-3, 0.6e-3, 0.8e-3, 1e-3, 1.3e-3, 1.99e-3};
    off_ = starts[random_() % 8] + from_to(-30e-6, 30e-6);
    pace_ = one_in(2) ? 0 : from_to(-0.7, 0.7);
    doubt_ = one_in(2) ? 0 : from_to(0, 0.3e-3);
    error_ = Vector3d(from_to(-1, 1), from_to(-1, 1), from_to(-1, 1)) * 1e-3;
    often_kept_out_ = one_in(3) ? 20 : 2000;
  }
  std::mt19937 random_;
  Vector3d retina_, lens_, error_{0, 0, -0.5e-3};
  double time_ = 3, off_ = 0.5e-3, pace_ = 0, doubt_ = 0;  // s, m, -, m
  unsigned often_kept_out_ = 2000;
};

/// Of how many sights each was said.
struct Said {
  int inside = 0, pressed = 0, lying = 0, sights = 0;
};

TEST(WallWatch, SaysWhatItsHeaderSaysOfTheWholeHistory) {
  Said said;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    Patient patient(seed);
    WallWatch watch(kMargin);
    Reference reference;
    for (int k = 0; k < 1500; ++k, ++said.sights) {
      if (patient.one_in(400)) {
        watch.forget();
        reference.forget();
      }
      const WallSight s = patient.next();
      const WallWatch::Verdict told = watch.see(s), wanted = reference.see(s);
      ASSERT_EQ(told.inside, wanted.inside) << seed << " " << k;
      ASSERT_EQ(told.pressed, wanted.pressed) << seed << " " << k;
      ASSERT_EQ(told.lying, wanted.lying) << seed << " " << k;
      said.inside += told.inside;
      said.pressed += told.pressed;
      said.lying += told.lying;
    }
  }
  for (const int count : {said.inside, said.pressed, said.lying}) {
    EXPECT_GT(count, said.sights / 100);
    EXPECT_LT(count, said.sights / 2);
  }
}

/// Over the retina, pushed towards it or not; the lens is far.
WallSight over_the_retina(double time, double distance, double height, double error) {
  WallSight s;
  s.time = time;
  s.clearance.retina.distance = distance;
  s.clearance.lens = {10e-3, Vector3d(0, 0, -1), 0};
  s.position.z() = height;
  s.target.z() = height - error;
  return s;
}

// The 0.05 mm are of the way in only, and half a second is long enough (docs/safety.md).
TEST(WallWatch, InTheMarginByTheHysteresisIsNotInsideAndAtTheMarginIsOutside) {
  const auto said_at = [](double first, double second) {
    WallWatch watch(kMargin);
    watch.see(over_the_retina(0, 0.5 * kMargin, 0, 0));
    const bool early = watch.see(over_the_retina(0.25, first, 0, 0)).inside;
    const bool then = watch.see(over_the_retina(WallWatch::kBriefly, first, 0, 0)).inside;
    return early ? -1 : then + 2 * watch.see(over_the_retina(0.75, second, 0, 0)).inside;
  };
  constexpr double kIn = kMargin - WallWatch::kHysteresis;
  EXPECT_EQ(said_at(kIn, kIn), 0);
  EXPECT_EQ(said_at(kIn - 1e-9, kIn + 1e-9), 3);
  EXPECT_EQ(said_at(kIn - 1e-9, kMargin - 1e-9), 3);
  EXPECT_EQ(said_at(kIn - 1e-9, kMargin), 1);
}

TEST(WallWatch, ATouchOfExactlyTheReachAndTheTimeIsLying) {
  const auto lies = [](double distance, double end) {
    WallWatch watch(kMargin);
    watch.see(over_the_retina(0, distance, 0, 0));
    return watch.see(over_the_retina(end, distance, 0, 0)).lying;
  };
  EXPECT_TRUE(lies(WallWatch::kTouches, WallWatch::kLies));
  EXPECT_FALSE(lies(WallWatch::kTouches + 1e-9, WallWatch::kLies));
  EXPECT_FALSE(lies(WallWatch::kTouches, WallWatch::kLies - 1e-6));
  EXPECT_TRUE(lies(-1e-3, WallWatch::kLies)) << "in the wall, as far as is known";
}

TEST(WallWatch, PressedIsNearerThanLeftMoreThanAndMovedLessThan) {
  const auto pressed = [](double distance, double error, double moved, double end) {
    WallWatch watch(kMargin);
    watch.see(over_the_retina(0, distance, moved, error));
    return watch.see(over_the_retina(end, distance, 0, error)).pressed;
  };
  constexpr double kLess = 1 - 1e-9, kMore = 1 + 1e-9, kClose = 0.5e-3, kLeft = 0.5e-3;
  EXPECT_TRUE(pressed(kClose, kLeft, 0, WallWatch::kLong));
  EXPECT_FALSE(pressed(kClose, kLeft, 0, WallWatch::kLong * kLess));
  EXPECT_TRUE(pressed(WallWatch::kNear * kLess, kLeft, 0, 2));
  EXPECT_FALSE(pressed(WallWatch::kNear, kLeft, 0, 2));
  EXPECT_TRUE(pressed(kClose, WallWatch::kError * kMore, 0, 2));
  EXPECT_FALSE(pressed(kClose, WallWatch::kError, 0, 2));
  EXPECT_FALSE(pressed(kClose, -kLeft, 0, 2)) << "told to go away from it";
  EXPECT_TRUE(pressed(kClose, kLeft, WallWatch::kStill * kLess, 2));
  EXPECT_FALSE(pressed(kClose, kLeft, WallWatch::kStill, 2));
  EXPECT_TRUE(pressed(kClose, kLeft, -1e-3, 2)) << "it went away: it does not come nearer";
}

TEST(WallWatch, WhatMovedBeforeTheLastSecondAndAHalfIsNotCounted) {
  WallWatch watch(kMargin);
  watch.see(over_the_retina(0, 0.5e-3, 1e-3, 0.5e-3));
  watch.see(over_the_retina(0.5, 0.5e-3, 0, 0.5e-3));
  EXPECT_TRUE(watch.see(over_the_retina(0.5 + WallWatch::kLong, 0.5e-3, 0, 0.5e-3)).pressed);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
