// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/line_derivative.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <random>

namespace vitreo::optics::detail {
namespace VITREO_TEST_FILE {

Surface lens_surface(double conic, double a4, double a6) {
  Surface surface;
  surface.radius = -12e-3;
  surface.conic = conic;
  surface.aspheric = {a4, a6, 0, 0};
  return surface;
}

Eigen::Matrix<double, 7, 1> standing(std::mt19937_64& random) {
  std::uniform_real_distribution<double> even(-1, 1);
  Eigen::Matrix<double, 7, 1> numbers;
  numbers << 0.5e-3 * even(random), 0.5e-3 * even(random), 25e-3 + 1e-3 * even(random),
      0.1 * even(random), 0.1 * even(random), 1 / -12e-3 * (1 + 0.1 * even(random)),
      1 / 1.336 * (1 + 0.02 * even(random));
  return numbers;
}

LineOf<double> coming(std::mt19937_64& random) {
  std::uniform_real_distribution<double> even(-1, 1);
  return {4e-3 * even(random), 4e-3 * even(random), 0.2 * even(random), 0.2 * even(random)};
}

/// Ceres' Jets through refract_inwards() itself: no formula of a derivative is in them.
StepDerivative by_jets(const Surface& shape, const Eigen::Matrix<double, 7, 1>& numbers,
                       const LineOf<double>& outer) {
  using Jet = ceres::Jet<double, 11>;
  LineOf<Jet> line;
  Eigen::Matrix<Jet, 7, 1> of_surface;
  for (int i = 0; i < 4; ++i) line[i] = Jet(outer[i], i);
  for (int i = 0; i < 7; ++i) of_surface[i] = Jet(numbers[i], 4 + i);
  ChainRefraction<Jet> met;
  StepDerivative by = StepDerivative::Zero();
  EXPECT_TRUE(refract_inwards(chain_step(shape, of_surface), line, met));
  for (int i = 0; i < 4; ++i) by.row(i) = line[i].v;
  return by;
}

TEST(LineDerivative, IsThatOfJetsForConicsAndAspheresThatAreMovedAndTurned) {
  std::mt19937_64 random(3);
  for (const Surface& shape :
       {lens_surface(0, 0, 0), lens_surface(-1.4, 0, 0), lens_surface(-0.7, 40, 3e5)})
    for (int i = 0; i < 200; ++i) {
      const auto numbers = standing(random);
      const LineOf<double> outer = coming(random);
      LineOf<double> line = outer;
      StepDerivative by;
      ASSERT_TRUE(refract_inwards(chain_step(shape, numbers), line, by));
      const StepDerivative theirs = by_jets(shape, numbers, outer);
      // Each column has its own unit: compared by its own size.
      for (int column = 0; column < 11; ++column)
        EXPECT_LT((by.col(column) - theirs.col(column)).norm(), 1e-11 * theirs.col(column).norm())
            << "conic " << shape.conic << ", column " << column;
    }
}

TEST(LineDerivative, OfALineThatMissesOrIsReflectedThereIsNone) {
  Eigen::Matrix<double, 7, 1> numbers;
  numbers << 0, 0, 25e-3, 0, 0, 1 / -12e-3, 1 / 1.336;
  StepDerivative by;
  LineOf<double> aside(20e-3, 0, 0, 0);
  EXPECT_FALSE(refract_inwards(chain_step(lens_surface(0, 0, 0), numbers), aside, by));
  numbers[6] = 1.336;  // out of the denser medium
  LineOf<double> steep(10e-3, 0, 0, 0);
  EXPECT_FALSE(refract_inwards(chain_step(lens_surface(0, 0, 0), numbers), steep, by));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics::detail
