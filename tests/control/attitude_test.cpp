// SPDX-License-Identifier: Apache-2.0
#include "control/attitude_law.h"
#include "control/direction_path.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <numbers>
#include <random>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr double kDegree = std::numbers::pi / 180;

double angle(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

TEST(DirectionPath, GoesAlongTheGreatArcAtItsRate) {
  const Eigen::Vector3d from = Eigen::Vector3d::UnitX(), to = Eigen::Vector3d(0, 1, 1).normalized();
  const DirectionPath path = DirectionPath::through({from, to}, 0.5);
  EXPECT_EQ(path.at(-1), from);
  EXPECT_LT((path.at(path.duration() + 1) - to).norm(), 1e-12);
  double fastest = 0;
  const double h = path.duration() / 1000;
  for (int k = 0; k < 1000; ++k) {
    const Eigen::Vector3d here = path.at(k * h);
    EXPECT_NEAR(here.norm(), 1, 1e-12);
    EXPECT_NEAR(here.dot(from.cross(to)), 0, 1e-12);  // in the plane of both
    fastest = std::max(fastest, angle(here, path.at((k + 1) * h)) / h);
  }
  EXPECT_NEAR(fastest, 0.5, 1e-3);
  EXPECT_NEAR(path.fastest(), 0.5, 1e-9);
}

TEST(DirectionPath, KeepsToItsTimesAndRefusesWhatHasNoArc) {
  const DirectionPath path = DirectionPath::timed(
      {Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitZ()}, {0, 2, 3});
  EXPECT_LT((path.at(2) - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  EXPECT_NEAR(angle(path.at(1), Eigen::Vector3d::UnitX()), std::numbers::pi / 4, 1e-12);
  EXPECT_THROW(DirectionPath::through({Eigen::Vector3d::UnitX(), -Eigen::Vector3d::UnitX()}, 1),
               std::invalid_argument);
  EXPECT_THROW(DirectionPath::hold(Eigen::Vector3d::Zero()), std::invalid_argument);
  EXPECT_THROW(DirectionPath::through({Eigen::Vector3d::UnitX()}, 0), std::invalid_argument);
}

/// A field that coils turn by `error` (rad, a rotation vector), an axis that follows it, seen 15
/// times a second, `delay` frames late, with noise. Returns the angle off after 6 seconds.
double off_after(const Eigen::Vector3d& error, int delay, bool either_end, double noise) {
  AttitudeGains gains;
  gains.either_end = either_end;
  AttitudeLaw law(gains);
  std::mt19937 random(4);
  std::normal_distribution<double> normal(0, noise);
  const Eigen::AngleAxisd turned(error.norm(), error.normalized());
  const Eigen::Vector3d wanted = Eigen::Vector3d(1, 0.3, 0.5).normalized();
  std::deque<Eigen::Vector3d> coming;
  Eigen::Vector3d axis = wanted;
  double sum = 0;
  for (int k = 0; k < 15 * 8; ++k) {
    axis = turned * law.field_direction(wanted);
    if (k >= 15 * 6) sum += angle(axis, wanted) / (15 * 2);
    coming.push_back(either_end && k % 2 == 0 ? Eigen::Vector3d(-axis) : axis);
    if (static_cast<int>(coming.size()) <= delay) continue;
    Eigen::Vector3d seen = coming.front();
    coming.pop_front();
    for (double& part : seen) part += normal(random);
    law.update(seen.normalized(), noise, wanted, 1 / 15.0);
  }
  return sum;
}

TEST(AttitudeLaw, MakesGoodWhatTheCoilsTurnTheField) {
  for (const bool either_end : {false, true}) {
    const Eigen::Vector3d error(4 * kDegree, -3 * kDegree, 5 * kDegree);
    EXPECT_LT(off_after(error, 3, either_end, 1e-4), 0.1 * kDegree);
    EXPECT_LT(off_after(error, 3, either_end, 0.02), 0.6 * kDegree);
  }
}

// 0.4 s late the loop is still far from the limit of 1.3 s.
TEST(AttitudeLaw, IsStableWithALateMeasurement) {
  EXPECT_LT(off_after({5 * kDegree, 5 * kDegree, 0}, 6, false, 1e-4), 0.3 * kDegree);
}

TEST(AttitudeLaw, GoesNoFartherThanItsBound) {
  AttitudeLaw law({});
  for (int k = 0; k < 1000; ++k)
    law.update(Eigen::Vector3d::UnitX(), 0.01, Eigen::Vector3d::UnitY(), 1 / 15.0);
  EXPECT_NEAR(law.correction().norm(), AttitudeGains{}.most, 1e-9);
  law.update(Eigen::Vector3d::Constant(NAN), 0.01, Eigen::Vector3d::UnitY(), 1 / 15.0);
  EXPECT_TRUE(law.correction().allFinite());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
