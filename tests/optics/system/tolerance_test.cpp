// Uncertain eyes: table 5.1 as data, one parameter at a time, and all of them at once.
// SPDX-License-Identifier: Apache-2.0
#include "optics/system/tolerance.h"

#include "optics/system/first_order.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

TEST(Tolerance, Table51HasElevenParametersOfTheEyeAndTheLensIndexAtFourPerCent) {
  const auto table = table_5_1();
  EXPECT_EQ(table.size(), 11u);
  const Prescription eye = prescription("navarro_condensing");
  EXPECT_EQ(applicable(table, eye).size(), 11u);
  for (const Uncertainty& one : table) {
    EXPECT_NO_THROW((void)parameter(eye, one.parameter)) << one.parameter;
    EXPECT_TRUE(one.parameter != "lens.index" || one.relative == 0.04);
  }
  EXPECT_EQ(applicable(table, prescription("model_eye_in_air")).size(),
            3u);  // no cornea, no aqueous, air, and a flat face
}

TEST(Tolerance, OneParameterAtATimeChangesThatOneAlone) {
  const Prescription eye = prescription("navarro_condensing");
  for (const Uncertainty& one : table_5_1()) {
    for (double sigmas : {-1.0, 1.0}) {
      const Prescription off = perturbed(eye, one, sigmas);
      for (const Parameter& its : parameters(eye)) {
        const double expected =
            its.name == one.parameter ? its.value * (1 + sigmas * one.relative) : its.value;
        EXPECT_EQ(parameter(off, its.name), expected) << its.name;
      }
    }
  }
}

TEST(Tolerance, TheLensIndexMovesTheImageOfTheRetinaMost) {
  const Prescription eye = prescription("navarro_condensing");
  const double home = axial_image(eye.system, 0)->distance;
  double most = 0;
  std::string which;
  for (const Uncertainty& one : table_5_1()) {
    const double moved = std::abs(axial_image(perturbed(eye, one, 1).system, 0)->distance - home);
    if (moved > most) {
      most = moved;
      which = one.parameter;
    }
  }
  EXPECT_EQ(which, "lens.index");
}

TEST(Tolerance, ThousandEyesHaveTheSpreadOfTheTable) {
  std::mt19937_64 random(7);
  const Prescription eye = prescription("navarro_condensing");
  const auto table = table_5_1();
  constexpr int kEyes = 1000;
  const auto eyes = monte_carlo(eye, table, kEyes, random);
  ASSERT_EQ(eyes.size(), static_cast<std::size_t>(kEyes));
  for (std::size_t i = 0; i < table.size(); ++i) {
    const double value = parameter(eye, table[i].parameter);
    double mean = 0, square = 0;
    for (const PerturbedEye& one : eyes) {
      const double off = parameter(one.prescription, table[i].parameter) / value - 1;
      EXPECT_NEAR(off, one.sigmas[i] * table[i].relative, 1e-12);
      mean += off / kEyes;
      square += off * off / kEyes;
    }
    EXPECT_NEAR(mean / table[i].relative, 0, 0.13) << i;  // four sigma of a mean of 1000
    EXPECT_NEAR(std::sqrt(square) / table[i].relative, 1, 0.09) << i;  // and of a spread
  }
}

TEST(Tolerance, TheSameSeedGivesTheSameEyes) {
  std::mt19937_64 one(3), other(3);
  const Prescription eye = prescription("model_eye_5_3");
  const auto a = monte_carlo(eye, table_5_1(), 5, one), b = monte_carlo(eye, table_5_1(), 5, other);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(a[i].sigmas, b[i].sigmas);
}

TEST(Tolerance, UncertaintiesThatMakeNoSenseAreRefused) {
  std::mt19937_64 random(1);
  const Prescription eye = prescription("navarro");
  expect_refused("lens.index", [&] { (void)perturbed(eye, {"lens.index", -0.1, ""}, 1); });
  expect_refused("lens.index", [&] { (void)perturbed(eye, {"lens.index", 0.9, ""}, -1); });
  expect_refused("parameter", [&] { (void)perturbed(eye, {"lens.color", 0.1, ""}, 1); });
  expect_refused("count", [&] { (void)monte_carlo(eye, table_5_1(), -1, random); });
  // Media of index 1, each half of the time below it: one draw in 2^13 is an eye, and 1000 are
  // tried.
  Prescription thin = eye;
  std::vector<Uncertainty> half;
  for (int i = 0; i < thin.system.size(); ++i) {
    thin.system.surfaces[i].index = 1;
  }
  thin.system.surfaces.insert(thin.system.surfaces.begin() + 1, 13, thin.system.surfaces[1]);
  for (int i = 0; i < 13; ++i) {
    thin.surfaces.insert(thin.surfaces.begin() + 1, "extra_" + std::to_string(i));
    thin.media.insert(thin.media.begin() + 1, "extra_" + std::to_string(i));
    half.push_back({"extra_" + std::to_string(i) + ".index", 0.5, ""});
  }
  expect_refused("uncertainties", [&] { (void)monte_carlo(thin, half, 1, random); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
