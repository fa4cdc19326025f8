// MotionWatch's standstill and its way to the target against its header's words, told by the whole
// history each time anew.
// SPDX-License-Identifier: Apache-2.0
#include "control/motion_watch.h"
#include "tests/control/watched_motion.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <random>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;

enum class Answer { no, yes, unclear };

/// The header's words over all turns since the begin. What they leave open - by which rule the
/// speed that is wanted is summed up, how the way is measured that is gone - is worth a tenth.
class Reference {
 public:
  void add(const WatchedMotion& now) {
    if (!seen_.empty() && now.time < seen_.back().time) *this = Reference();
    seen_.push_back(now);
    if (looked_ && now.time - *looked_ < 0.5) return;
    looked_ = now.time;
    standing = stands();
    off_target = stays_away();
  }
  Answer standing = Answer::no, off_target = Answer::no;

 private:
  std::vector<WatchedMotion> lately(double span) const {
    std::vector<WatchedMotion> last;
    for (const WatchedMotion& one : seen_) {
      if (one.time >= seen_.back().time - span) last.push_back(one);
    }
    return last;
  }
  Answer stands() const {
    const std::vector<WatchedMotion> last = lately(2);
    if (last.back().time - seen_.front().time < 2 + kCaught) return Answer::no;
    Vector3d told(0, 0, 0);
    for (std::size_t k = 1; k < last.size(); ++k) {
      told += (last[k].time - last[k - 1].time) * (last[k].wanted + last[k - 1].wanted) / 2;
    }
    if (told.norm() < 0.36e-3) return Answer::no;
    const double part =
        (last.back().position - last.front().position).dot(told) / told.squaredNorm();
    if (part > 0.22) return Answer::no;
    return told.norm() > 0.44e-3 && part < 0.18 ? Answer::yes : Answer::unclear;
  }
  Answer stays_away() const {
    const std::vector<WatchedMotion> last = lately(3);
    if (last.back().time - seen_.front().time < 3) return Answer::no;
    for (const WatchedMotion& one : last) {
      if (one.error.norm() <= 2e-3) return Answer::no;
    }
    const double nearer = last.front().error.norm() - last.back().error.norm();
    return nearer < 0.3e-3 ? Answer::yes : Answer::no;
  }
  std::vector<WatchedMotion> seen_;
  std::optional<double> looked_;
};

/// A robot that follows, stands, or goes elsewhere than it is told, for some seconds each.
class Patient {
 public:
  explicit Patient(unsigned seed) : random_(seed) {}
  bool one_in(unsigned count) { return random_() % count == 0; }
  double from_to(double low, double high) {
    return low + (high - low) * (static_cast<double>(random_()) / 4294967296.0);
  }
  WatchedMotion next() {
    if (one_in(40)) begin_a_stretch();
    time_ = one_in(500) ? std::floor(0.7 * time_) : time_ + kTurn;
    position_ += kTurn * velocity_;
    error_ += kTurn * leaves_;
    WatchedMotion now;
    now.time = time_;
    now.position = position_;
    now.error = error_;
    now.wanted = wanted_ + 0.02e-3 * any();
    return now;
  }

 private:
  Vector3d any() {
    const double x = from_to(-1, 1), y = from_to(-1, 1);
    return {x, y, from_to(-1, 1)};
  }
  void begin_a_stretch() {
    wanted_ = from_to(0, 1e-3) * any();
    velocity_ = one_in(2) ? Vector3d(0, 0, 0) : Vector3d(from_to(-0.5, 1) * wanted_);
    if (one_in(3)) error_ = from_to(0, 8e-3) * any();
    leaves_ = one_in(2) ? Vector3d(0, 0, 0) : Vector3d(from_to(0, 0.3e-3) * any());
  }
  std::mt19937 random_;
  double time_ = 9;
  Vector3d position_{0, 0, 0}, velocity_{0, 0, 0}, wanted_{0.5e-3, 0, 0}, error_{0, 3e-3, 0},
      leaves_{0, 0, 0};
};

TEST(MotionWatch, StandsAndStaysAwayAsItsHeaderSaysOfTheWholeHistory) {
  int stood = 0, away = 0, turns = 0;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    Patient patient(seed);
    MotionWatch watch;
    Reference reference;
    for (int k = 0; k < 800; ++k, ++turns) {
      if (patient.one_in(500)) {
        watch.reset();
        reference = Reference();
      }
      const WatchedMotion now = patient.next();
      watch.add(now);
      reference.add(now);
      ASSERT_EQ(watch.off_target(), reference.off_target == Answer::yes) << seed << " " << k;
      away += watch.off_target();
      if (reference.standing == Answer::unclear) continue;
      ASSERT_EQ(watch.standing(), reference.standing == Answer::yes) << seed << " " << k;
      stood += watch.standing();
    }
  }
  for (const int count : {stood, away}) {
    EXPECT_GT(count, turns / 20);
    EXPECT_LT(count, turns / 2);
  }
}

/// s, when it is first said, of looks up to 20 s; -1: never.
double first_said(const MakeMotion& make, bool (MotionWatch::*said)() const) {
  for (double until = 0; until < 20; until += kTurn) {
    if ((watched(until, make).*said)()) return until;
  }
  return -1;
}

// Docs: 0.4 mm in 2 s and more, less than a fifth; from kCaught s after the begin.
TEST(MotionWatch, ToldExactlySoFarItStandsAndAFifthOfTheWayIsGoing) {
  const auto stands = [](double told, const Vector3d& went, double when = 3.5) {
    const MakeMotion make = [&](WatchedMotion& now) {
      now.wanted.x() = now.time == when ? told / kTurn : 0;
      now.position = (now.time > 3 ? 1 : 0) * went;
    };
    return watched(4.5, make).standing();
  };
  EXPECT_TRUE(stands(0.4e-3, {0, 0, 0}));
  EXPECT_FALSE(stands(0.4e-3 * (1 - 1e-9), {0, 0, 0}));
  EXPECT_TRUE(stands(0.4e-3, {0, 0, 0}, 2.5));
  EXPECT_FALSE(stands(0.4e-3, {0, 0, 0}, 2.5 - kTurn)) << "before the last two seconds";
  const double fifth = std::ldexp(1, -12);  // m: of a way that is exact in binary
  EXPECT_FALSE(stands(5 * fifth, {fifth, 0, 0}));
  EXPECT_TRUE(stands(5 * fifth, {0.999 * fifth, 0, 0}));
  EXPECT_TRUE(stands(5 * fifth, {-fifth, 0, 0})) << "it goes the other way";
  EXPECT_TRUE(stands(5 * fifth, {0, 9 * fifth, 0})) << "what carries it aside is no answer";
  const MakeMotion told = [](WatchedMotion& now) { now.wanted = {0, 0.3e-3, -0.4e-3}; };
  EXPECT_EQ(first_said(told, &MotionWatch::standing), 2 + kCaught);
}

TEST(MotionWatch, StaysAwayBeyondTwoMillimetersAndForExactlyThreeSeconds) {
  const auto away = [](double first, double then, bool free = true) {
    const MakeMotion make = [&](WatchedMotion& now) {
      now.error.y() = now.time == 0 ? first : then;
      now.free = free || now.time != 1;
    };
    return watched(3, make).off_target();
  };
  EXPECT_TRUE(away(2.001e-3, 2.001e-3));
  EXPECT_FALSE(away(2e-3, 2e-3)) << "farther than 2 mm";
  EXPECT_FALSE(away(1.9e-3, 2.5e-3));
  EXPECT_TRUE(away(2.799e-3, 2.5e-3));
  EXPECT_FALSE(away(2.801e-3, 2.5e-3));
  EXPECT_FALSE(away(3e-3, 3e-3, false)) << "the medium yields in one turn";
  const MakeMotion far = [](WatchedMotion& now) { now.error = {2e-3, -3e-3, 1e-3}; };
  EXPECT_EQ(first_said(far, &MotionWatch::off_target), 3);
  const MakeMotion leaves = [](WatchedMotion& now) {
    now.error.z() = now.time < 1.2 ? 1e-3 : 3e-3;
  };
  EXPECT_EQ(first_said(leaves, &MotionWatch::off_target), 4.5) << "looked at every half second";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
