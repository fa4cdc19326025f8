// Lack of a coil: the force that is missing without a part of its current, and the most probable
// part, each beside a calculation that goes another way.
// SPDX-License-Identifier: Apache-2.0
#include "control/coil_lack.h"

#include "control/stability.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const Robot kRobot = coni_2mm();
const Medium kOil;

// N, that the robot loses where one coil carries `left` of its current.
Eigen::Vector3d lost_by_currents(Currents currents, int coil, double left) {
  const FieldModel field = CoilField::octomag();
  const Eigen::Vector3d whole = force_at(field, kRobot, kOil, currents, {0, 0, 0});
  currents[coil] *= left;
  return whole - force_at(field, kRobot, kOil, currents, {0, 0, 0});
}

Currents some_currents() {
  Currents currents(8);
  currents << 4, -2, 3, 1, -5, 6, 2, -3;
  return currents;
}

TEST(LostForce, is_what_the_force_lacks_at_half_and_at_all_of_a_current_and_near_it_between) {
  const FieldModel field = CoilField::octomag();
  const Currents currents = some_currents();
  const FieldMatrix matrix = field.matrix({0, 0, 0});
  const FieldGradient whole = matrix * currents + field.background({0, 0, 0});
  for (int coil = 0; coil < 8; ++coil) {
    const LostForce lost = lost_force(kRobot, whole, matrix.col(coil) * currents[coil]);
    const double size = lost_by_currents(currents, coil, 0).norm();
    for (const double lack : {0.25, 0.5, 0.75, 1.0}) {
      const Eigen::Vector3d expected = lost_by_currents(currents, coil, 1 - lack);
      const Eigen::Vector3d found = lack * lost.linear + lack * lack * lost.curved;
      const double allowed = std::fmod(lack, 0.5) == 0 ? 1e-9 : 0.05;
      EXPECT_LT((found - expected).norm(), allowed * size) << coil << " at " << lack;
    }
    EXPECT_GT(lost.curved.norm(), 0.03 * size) << "half of a coil is not half of a whole one";
  }
}

// Sums over so many observations of a lack.
LackSums seen(double lack, double noise, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  LackSums sums;
  for (int k = 0; k < 40; ++k) {
    const double s = normal(random), t = 0.5 * normal(random) + 0.4 * s;
    const double v = s * lack + t * lack * lack + noise * normal(random);
    sums.linear += s * v;
    sums.curved += t * v;
    sums.information += s * s;
    sums.mixed += s * t;
    sums.curved_square += t * t;
  }
  return sums;
}

TEST(MostProbableLack, is_where_the_sum_of_squares_falls_most) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> any(0, 1.2);
  for (int round = 0; round < 200; ++round) {
    const LackSums sums = seen(any(random), 0.3, random);
    double best = 0, where = 0;
    for (double c = 0.3; c <= 1; c += 1e-4)
      if (sums.ratio(c) > best) {
        best = sums.ratio(c);
        where = c;
      }
    const Lack found = most_probable_lack(sums, 0.3, 1);
    if (best == 0) continue;
    EXPECT_GT(found.ratio, 0.995 * best);
    EXPECT_NEAR(found.part, where, 0.03);
  }
}

TEST(MostProbableLack, is_exact_without_noise_and_stays_within_its_bounds) {
  std::mt19937_64 random(8);
  for (const double lack : {0.35, 0.5, 0.62, 0.8, 0.97})
    EXPECT_NEAR(most_probable_lack(seen(lack, 0, random), 0.3, 1).part, lack, 0.01);
  EXPECT_EQ(most_probable_lack(seen(2, 0, random), 0.3, 1).part, 1);
  EXPECT_EQ(most_probable_lack(seen(0.1, 0, random), 0.3, 1).part, 0.3);
}

TEST(MostProbableLack, says_nothing_of_a_coil_that_gives_more_than_it_was_given) {
  std::mt19937_64 random(9);
  EXPECT_EQ(most_probable_lack(seen(-0.5, 0, random), 0.3, 1).ratio, 0);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
