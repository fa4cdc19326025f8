// Standstill against its header's words, told by the whole history each time anew.
// SPDX-License-Identifier: Apache-2.0
#include "control/standstill.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;

struct Sight {
  double time;
  Vector3d place;
  double sigma;
  Vector3d told;  // m, since the sight before
};

enum class Answer { no, yes, unclear };

/// The header's words over all sights since the begin.
class Reference {
 public:
  explicit Reference(double least_told = 0.4e-3) : least_told_(least_told) {}
  Answer add(const Sight& now) {
    if (!seen_.empty() && now.time < seen_.back().time) seen_.clear();
    seen_.push_back(now);
    Vector3d told(0, 0, 0);
    for (int k = static_cast<int>(seen_.size()) - 1; k > 0; --k) {
      told += seen_[k].told;
      const bool long_enough = now.time - seen_[k - 1].time >= 1.25;
      if (long_enough && told.norm() >= std::max(least_told_, 10 * now.sigma)) {
        return in_one_place(k - 1);
      }
    }
    return Answer::no;
  }

 private:
  Answer in_one_place(int first) const {
    // In sigmas, of a coordinate's half range. Within two of them no place is farther than four
    // from any mean; where it is six, one place is six from any.
    double least = 0, most = 0;
    for (int axis = 0; axis < 3; ++axis) {
      double low = 1e9, high = -1e9, small = 1e9, large = 0;
      for (auto s = seen_.begin() + first; s != seen_.end(); ++s) {
        low = std::min(low, s->place[axis]);
        high = std::max(high, s->place[axis]);
        small = std::min(small, s->sigma);
        large = std::max(large, s->sigma);
      }
      least = std::max(least, (high - low) / 2 / large);
      most = std::max(most, (high - low) / 2 / small);
    }
    return most < 2 ? Answer::yes : least > 6 ? Answer::no : Answer::unclear;
  }
  double least_told_;
  std::vector<Sight> seen_;
};

/// A robot that is held, goes, or goes elsewhere than it is told, for some seconds each.
class Patient {
 public:
  explicit Patient(unsigned seed) : random_(seed), sigma_(from_to(4e-6, 60e-6)) {}
  bool one_in(unsigned count) { return random_() % count == 0; }
  Sight next() {
    const double step = one_in(30) ? from_to(0.1, 1.5) : from_to(0.03, 0.1);
    if (one_in(25)) begin_a_stretch();
    time_ = one_in(150) ? from_to(0, time_ - 0.01) : time_ + step;
    at_ += step * velocity_;
    const Vector3d noise = 1.7 * sigma_ * any();  // uniform, of one sigma
    const Vector3d told = step * (told_ + 0.1e-3 * any());
    return {time_, at_ + noise, one_in(4) ? sigma_ * from_to(1, 1.1) : sigma_, told};
  }

 private:
  double from_to(double low, double high) {
    return low + (high - low) * (static_cast<double>(random_()) / 4294967296.0);
  }
  Vector3d any() {
    const double x = from_to(-1, 1), y = from_to(-1, 1);
    return {x, y, from_to(-1, 1)};
  }
  void begin_a_stretch() {
    if (!one_in(3)) told_ = from_to(0, 0.8e-3) * any();
    velocity_ = one_in(2) ? Vector3d(0, 0, 0) : Vector3d(from_to(0.3, 1) * told_);
    if (one_in(5)) velocity_ = from_to(0, 0.5e-3) * any();
  }
  std::mt19937 random_;
  double sigma_, time_ = 7;
  Vector3d at_{1e-3, -2e-3, 0.5e-3}, velocity_{0, 0, 0}, told_{0.2e-3, 0, 0};
};

TEST(Standstill, SaysWhatItsHeaderSaysOfTheWholeHistory) {
  int stood = 0, went = 0;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    Patient patient(seed);
    const double least_told = seed % 3 == 0 ? 0.9e-3 : 0.4e-3;
    Standstill watch(least_told);
    Reference reference(least_told);
    for (int k = 0; k < 600; ++k) {
      if (patient.one_in(300)) {
        watch.reset();
        reference = Reference(least_told);
        EXPECT_FALSE(watch.stands());
      }
      const Sight now = patient.next();
      watch.add(now.time, now.place, now.sigma, now.told);
      const Answer wanted = reference.add(now);
      if (wanted == Answer::unclear) continue;
      ASSERT_EQ(watch.stands(), wanted == Answer::yes) << seed << " " << k;
      ++(watch.stands() ? stood : went);
    }
  }
  EXPECT_GT(stood, 2000);
  EXPECT_GT(went, 2000);
}

/// Whether it stands at the end of a second and a quarter, told so much on the way, m, with a place
/// in between that is so far from all others, m.
bool stands(double told, double sigma, double off, double least_told = 0.4e-3, double end = 1.25) {
  Standstill watch(least_told);
  for (int k = 0; k < 40; ++k) {
    const Vector3d place(1e-3, -2e-3 + (k == 20 ? off : 0), 0);
    const Vector3d now = k == 10 ? Vector3d(0.6 * told, 0, -0.8 * told) : Vector3d(0, 0, 0);
    watch.add(k / 39.0 * end, place, sigma, now);
  }
  return watch.stands();
}

TEST(Standstill, TheLeastToldAndTenSigmasAndASecondAndAQuarterAreEnough) {
  constexpr double kLess = 1 - 1e-6, kMore = 1 + 1e-6;
  EXPECT_TRUE(stands(0.4e-3 * kMore, 4e-6, 0));
  EXPECT_FALSE(stands(0.4e-3 * kLess, 4e-6, 0));
  EXPECT_TRUE(stands(0.7e-3 * kMore, 4e-6, 0, 0.7e-3));
  EXPECT_FALSE(stands(0.7e-3 * kLess, 4e-6, 0, 0.7e-3));
  EXPECT_TRUE(stands(0.8e-3 * kMore, 80e-6, 0));
  EXPECT_FALSE(stands(0.8e-3 * kLess, 80e-6, 0)) << "ten standard deviations";
  EXPECT_FALSE(stands(1e-3, 4e-6, 0, 0.4e-3, 1.25 * kLess));
}

TEST(Standstill, ExactlyWhatIsAskedForIsEnoughAndTheFirstIsToldNothing) {
  const double told = 0.5e-3;
  Standstill watch(told);
  watch.add(2, {0, 0, 0}, 4e-6, {1, 0, 0});  // before there was anything to go from
  watch.add(3.25, {0, 0, 0}, 4e-6, {0, 0, 0});
  EXPECT_FALSE(watch.stands());
  watch.add(3.5, {0, 0, 0}, 4e-6, {told, 0, 0});
  EXPECT_TRUE(watch.stands());
  watch.reset();
  watch.add(0, {0, 0, 0}, 4e-6, {0, 0, 0});
  watch.add(1.25, {0, 0, 0}, 4e-6, {0.9 * told, 0, 0});
  EXPECT_FALSE(watch.stands()) << "the least that is told outlasts a reset";
  watch.reset();
  watch.add(0, {0, 0, 0}, 4e-6, {0, 0, 0});
  watch.add(1.25, {0, 0, 0}, 4e-6, {told, 0, 0});
  EXPECT_TRUE(watch.stands());
}

// Within noise: of some dozens of places the farthest is often at three standard deviations, and
// not at eight.
TEST(Standstill, APlaceThatIsOffByItsNoiseIsOfOnePlaceAndByMoreIsNot) {
  for (const double sigma : {0.5e-6, 4e-6, 80e-6}) {
    EXPECT_TRUE(stands(1e-3, sigma, 3 * sigma)) << sigma;
    EXPECT_TRUE(stands(1e-3, sigma, -3 * sigma)) << sigma;
  }
  for (const double sigma : {4e-6, 80e-6}) {
    EXPECT_FALSE(stands(1e-3, sigma, 8 * sigma)) << sigma;
    EXPECT_FALSE(stands(1e-3, sigma, -8 * sigma)) << sigma;
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
