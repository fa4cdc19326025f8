// What a loop's localizer states of its positions, on benches that are not the believed one.
// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/records/drawn_bench.h"

#include "host/servo/localizer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace vitreo::records {
namespace {

const Eigen::Vector3d kAxis(1, 0, 0);

struct Counted {
  int places = 0;
  Eigen::Vector3i within{0, 0, 0};
};

/// Each bench once: its errors are common to all its places.
Counted count(int benches, bool told) {
  Counted counted;
  for (int k = 0; k < benches; ++k) {
    DrawnBench bench({}, 7000 + static_cast<std::uint64_t>(k));
    std::mt19937_64 random(static_cast<std::uint64_t>(k));
    std::uniform_real_distribution<double> even(-1, 1);
    const Eigen::Vector3d place(2e-3 * even(random), 2e-3 * even(random), 2e-3 * even(random));
    RigModel model = bench.model();
    if (!told) model.uncertainty.bench = BenchUncertainty::none();
    Localizer localizer(model, bench.background(), kAxis, 0.07);
    const Observation seen = localizer.look(bench.picture(place, kAxis));
    if (!seen.position) continue;
    ++counted.places;
    for (int axis = 0; axis < 3; ++axis)
      counted.within[axis] +=
          std::abs((*seen.position - place)[axis]) < 1.96 * std::sqrt(seen.covariance(axis, axis));
  }
  return counted;
}

// Of 30 benches 28.5 are expected within 95 %, with a deviation of 1.2: 25 is three below.
TEST(DrawnBench, IsWithinWhatTheLocalizerStatesWhereTheRigSaysThatItWasSetUpByHand) {
  const Counted told = count(30, true);
  ASSERT_GE(told.places, 28);
  const int missing = 30 - told.places;
  for (int axis = 0; axis < 3; ++axis) EXPECT_GE(told.within[axis], 25 - missing) << axis;
  const Counted untold = count(30, false);
  EXPECT_LT(untold.within.minCoeff(), 20) << "without it the sigmas are too small";
}

}  // namespace
}  // namespace vitreo::records
