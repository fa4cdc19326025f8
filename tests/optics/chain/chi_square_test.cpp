// SPDX-License-Identifier: Apache-2.0
#include "optics/numerics/chi_square.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo::optics::detail {
namespace VITREO_TEST_FILE {

// Printed tables of the distribution.
TEST(ChiSquare, LimitsAreThoseOfTheTables) {
  EXPECT_NEAR(chi_square_limit(2, 0.005), 10.597, 0.11);
  EXPECT_NEAR(chi_square_limit(7, 0.01), 18.475, 0.05);
  EXPECT_NEAR(chi_square_limit(100, 0.005), 140.17, 0.1);
  EXPECT_NEAR(chi_square_limit(100, 0.5), 99.334, 0.1);
}

TEST(ChiSquare, BadArgumentsAreNamed) {
  EXPECT_THROW(chi_square_limit(0, 0.01), std::invalid_argument);
  EXPECT_THROW(chi_square_limit(2, 0), std::invalid_argument);
  EXPECT_THROW(chi_square_limit(2, 0.7), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics::detail
