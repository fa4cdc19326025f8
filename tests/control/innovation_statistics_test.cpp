// Innovation statistics on innovations of known size and correlation.
// SPDX-License-Identifier: Apache-2.0
#include "control/innovation_statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

/// After 4000 innovations v' = a v + noise, whose true covariance is `true_over_said` squared times
/// the one said.
InnovationStatistics of(double a, double true_over_said) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  InnovationStatistics statistics(100);
  Eigen::Vector3d value = Eigen::Vector3d::Zero();
  for (int k = 0; k < 4000; ++k) {
    for (double& coordinate : value)
      coordinate = a * coordinate + std::sqrt(1 - a * a) * normal(random);
    Innovation innovation;
    innovation.covariance = Eigen::Vector3d(4e-12, 9e-12, 25e-12).asDiagonal();
    innovation.value =
        true_over_said * innovation.covariance.diagonal().cwiseSqrt().cwiseProduct(value);
    innovation.normalized = true_over_said * true_over_said * value.squaredNorm();
    statistics.add(innovation, 1.0 / 15);
  }
  return statistics;
}

// 100 s at 15 a second are 3000 innovations of 3 coordinates in the mean: 2 % of chance, here five.
TEST(InnovationStatistics, AreOneAndZeroForAFilterThatIsRight) {
  EXPECT_NEAR(of(0, 1).normalized(), 1, 0.1);
  EXPECT_NEAR(of(0, 1).correlation(), 0, 0.1);
}

TEST(InnovationStatistics, ShowAFilterThatIsTooSureAndOneThatLags) {
  EXPECT_NEAR(of(0, 2).normalized(), 4, 0.6);  // less than 4 by the cut of the largest
  EXPECT_NEAR(of(0.6, 1).correlation(), 0.6, 0.1);
  EXPECT_NEAR(of(-0.6, 1).correlation(), -0.6, 0.1);
}

TEST(InnovationStatistics, SayNothingBeforeTheFirst) {
  InnovationStatistics statistics(10);
  EXPECT_EQ(statistics.normalized(), 0);
  EXPECT_EQ(statistics.correlation(), 0);
  EXPECT_THROW(InnovationStatistics(0), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
