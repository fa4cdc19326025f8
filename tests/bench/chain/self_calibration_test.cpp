// Self-calibration by frames of free flight: what it leaves, and its guards.
// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_planner.h"
#include "optics/chain/chain_refiner.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "sessions.h"
#include "true_bench.h"
#include <cmath>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

NominalChain believed_chain() {
  NominalChain nominal;
  nominal.prescription = prescription("model_eye_5_3");
  return nominal;
}

/// One frame of free flight into the refiner, at a place that it finds by its own chain.
RefinerOutcome fly(const TrueBench& truth, ChainRefiner& refiner, double time,
                   std::mt19937_64& random) {
  const ChainLook look = flight_look(truth, random);
  const auto near = locate_in_chain(refiner.belief().chain, look.seen, look.axis);
  if (!near) return RefinerOutcome::misfit;
  const RefinerOutcome outcome = refiner.add(look.seen, look.axis, *near, time);
  refiner.work(10);
  return outcome;
}

/// Forty frames of flight, to `refiner` and, as far as it took them, to `session`.
void fly(ChainRefiner& refiner, ChainSession& session, const TrueBench& truth,
         std::mt19937_64& random) {
  for (double time = 0; refiner.frames() < 40 && time < 2000; time += 5) {
    const ChainLook look = flight_look(truth, random);
    const auto near = locate_in_chain(refiner.belief().chain, look.seen, look.axis);
    if (!near) continue;
    if (refiner.add(look.seen, look.axis, *near, time) == RefinerOutcome::taken)
      session.looks.push_back(look);
    refiner.work(10);
  }
}

/// The recursive form and the estimator of whole sessions, from the same landings and frames: the
/// same chain. The height gets better by a tenth at least: 200 um of it were
/// left to calibration by the landings, 161 to 179 with 60 frames in three benches.
TEST(ChainSelfCalibration, FramesOfFlightLeaveWhatTheWholeSessionLeaves) {
  const NominalChain nominal = believed_chain();
  const TrueBench truth(nominal, {}, 21);
  std::mt19937_64 random(21);
  ChainSession session = landing_session(truth, random);
  const ChainEstimate landed = estimate_chain(nominal, {}, session, {.starts = 1});
  ChainRefiner refiner(landed.belief, {}, {session.looks, landed.places});
  fly(refiner, session, truth, random);
  ASSERT_EQ(refiner.frames(), 40U);
  EXPECT_FALSE(refiner.changed());
  refiner.work(3000);  // until searches for twins have ended: they count until then
  const ChainEstimate whole = estimate_chain(nominal, {}, session, {.starts = 1});
  const Eigen::VectorXd apart = refiner.belief().chain.theta() - whole.belief.chain.theta();
  // Of 41 unknowns the truth is some 41 away; what the two forms differ by is a small part of that.
  EXPECT_LT(apart.dot(whole.belief.covariance.ldlt().solve(apart)), 0.15);
  const double recursive = left_of(refiner.belief(), PlanGoal::height);
  EXPECT_LT(recursive, 0.95 * left_of(landed.belief, PlanGoal::height));
  // With the landings left as their own solution has them it was 9 % more.
  EXPECT_NEAR(recursive, left_of(whole.belief, PlanGoal::height), 0.02 * recursive);
}

/// Landings that are taken out of the prior and counted with the frames leave what prior, landings
/// and frames say together: of benches whose robot lay some degrees off its believed axis too.
TEST(ChainSelfCalibration, LandingsCountOnce) {
  const NominalChain nominal = believed_chain();
  for (const std::uint64_t seed : {4001, 4002, 4006, 4009}) {
    const TrueBench truth(nominal, {}, seed);
    std::mt19937_64 random(3000 + seed);
    ChainSession session = landing_session(truth, random);
    const ChainEstimate landed = estimate_chain(nominal, {}, session, {.starts = 1});
    ChainRefiner refiner(landed.belief, {}, {session.looks, landed.places});
    fly(refiner, session, truth, random);
    refiner.work(3000);
    const ViewingChain& chain = refiner.belief().chain;
    ChainSession shown;
    std::vector<Eigen::Vector3d> places;
    for (const ChainLook& look : session.looks) {
      const auto near = locate_in_chain(chain, look.seen, look.axis);
      if (!near) continue;
      shown.looks.push_back(look);
      places.push_back(*near);
    }
    const Eigen::MatrixXd all = Eigen::MatrixXd::Identity(chain.size(), chain.size()) +
                                session_information(chain, shown, places);
    const double whole = left_of({chain, all.inverse()}, PlanGoal::height);
    // 145 for 91 um, and 89 for 91, where an anchor was linearized beside its solution.
    EXPECT_NEAR(left_of(refiner.belief(), PlanGoal::height), whole, 0.05 * whole) << seed;
  }
}

TEST(ChainSelfCalibration, AFrameAtTheSamePlaceSoonAfterIsNoNewOne) {
  const NominalChain nominal = believed_chain();
  const TrueBench truth(nominal, {}, 3);
  std::mt19937_64 random(3);
  ChainRefiner refiner(prior_belief(nominal, {}));
  const auto seen = truth.seen({1e-3, 0, 5e-3}, {1, 0, 0}, kNoise_px, kAxisSigma, random);
  ASSERT_TRUE(seen);
  const Eigen::Vector3d near(1e-3, 0, 5e-3);
  EXPECT_EQ(refiner.add(*seen, {1, 0, 0}, near, 0), RefinerOutcome::taken);
  EXPECT_EQ(refiner.add(*seen, {1, 0, 0}, near, 1), RefinerOutcome::no_new);
  EXPECT_EQ(refiner.add(*seen, {1, 0, 0}, near, 4), RefinerOutcome::taken);
}

/// A hand that moves the condensing lens by a millimeter in the middle of a run: it stops, names
/// what moved, and knows the height no better than that allows.
TEST(ChainSelfCalibration, ALensThatWasMovedStopsIt) {
  const NominalChain nominal = believed_chain();
  const TrueBench truth(nominal, {}, 31);
  std::mt19937_64 random(31);
  ChainRefiner refiner(
      estimate_chain(nominal, {}, landing_session(truth, random), {.starts = 1}).belief);
  double time = 0;
  for (; refiner.frames() < 60 && time < 2000; time += 5) fly(truth, refiner, time, random);
  ASSERT_FALSE(refiner.changed());
  const double learned = left_of(refiner.belief(), PlanGoal::aside);
  const TrueBench moved = truth.moved({{"lens_aside_x", 1e-3}});
  for (const double end = time + 500; time < end && !refiner.changed(); time += 5)
    fly(moved, refiner, time, random);
  ASSERT_TRUE(refiner.changed());
  EXPECT_EQ(refiner.changed()->part, "condensing_lens");
  EXPECT_LE(refiner.frames(), 70U);
  EXPECT_GT(left_of(refiner.belief(), PlanGoal::aside), 1.2 * learned);
  EXPECT_EQ(fly(moved, refiner, time, random), RefinerOutcome::changed);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
