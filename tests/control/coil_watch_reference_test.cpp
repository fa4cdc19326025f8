// Coil watch beside a reference that keeps the whole history: random faults of random filters, and
// the edges of begins, bounds and thresholds.
// SPDX-License-Identifier: Apache-2.0
#include "tests/control/coil_watch_reference.h"

#include "control/coil_watch.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <cmath>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using namespace watch_reference;

/// A filter's innovations where one coil fails, for the watch and for the reference.
struct Bench {
  Bench(unsigned seed, int count)
      : draw(seed),
        coils(count),
        watch(count),
        reference(count),
        faults(draw.matrix(3, 2 * count, 1e-5)) {
    turned = draw.matrix(3, 3 * coils, 2e-5);
    healthy = draw.matrix(4 * coils, 1, 1);
  }
  void step(double span) {
    Step step;
    step.span = span;
    faults += draw.matrix(3, 2 * coils, 5e-6) - 0.2 * faults;
    if (!curved) faults.rightCols(coils).setZero();
    turned += draw.matrix(3, 3 * coils, 1e-5) - 0.2 * turned;
    step.faults = faults;
    step.turned = directions ? turned : MatrixXd::Zero(3, 3 * coils);
    step.update.gain << 0.35 * MatrixXd::Identity(3, 3) + draw.matrix(3, 3, 0.05),
        (MatrixXd::Identity(3, 3) + draw.matrix(3, 3, 0.3)) * 0.07 / span, draw.matrix(1, 3, 1500),
        draw.matrix(1, 3, 300);
    step.update.by_gain = draw.matrix(3, 1, 2e-5);
    step.update.by_delay = draw.matrix(3, 1, 3e-4);
    if (bounds && draw.between(0, 1) < 0.2)
      step.update.bounded << draw.matrix(3, 1, 3e-6), draw.matrix(3, 1, 4e-5),
          draw.matrix(1, 1, 0.2), draw.matrix(1, 1, 0.01);
    const MatrixXd root = 3e-6 * MatrixXd::Identity(3, 3) + draw.matrix(3, 3, 1e-6);
    step.innovation.covariance = root * root.transpose();
    MatrixXd moved(3, 4 * coils);
    moved << kGainError * step.faults.leftCols(coils), kTurnError * step.turned;
    const Vector3d sum =
        moved * healthy - lack * faults.col(coil - 1) - lack * lack * faults.col(coils + coil - 1);
    step.innovation.value = world.after(step, sum) + noise * root * draw.matrix(3, 1, 1);
    world.error -= step.update.bounded;
    hand_over(step);
  }
  void hand_over(const Step& step) {
    reference.history.push_back(step);
    CoilMotions given{step.faults.leftCols(coils)};
    if (curved) given.curved = step.faults.rightCols(coils);
    watch.add(step.innovation, step.update, step.span, given,
              directions ? CoilTurns(step.turned) : CoilTurns(3, 0));
  }
  void restart(double span) {
    Step step;
    step.span = span;
    step.restarted = true;
    step.faults = MatrixXd::Zero(3, 2 * coils);
    step.turned = MatrixXd::Zero(3, 3 * coils);
    world.after(step, {});
    reference.history.push_back(step);
    watch.restart(span);
  }
  /// Whether there was a finding to compare.
  bool compare() {
    const Finding expected = reference.most_suspect();
    if (!reference.comparable()) return false;
    const Finding found = watch.most_suspect();
    const double allowed = 1e-6 + 1e-6 * expected.evidence;
    EXPECT_NEAR(found.evidence, expected.evidence, allowed);
    EXPECT_NEAR(found.next, expected.next, allowed);
    if (expected.evidence - expected.next < 2 * allowed) return false;
    EXPECT_EQ(found.coil, expected.coil);
    EXPECT_NEAR(found.lack, expected.lack, 1e-3);
    EXPECT_NEAR(found.rest, expected.rest, 1e-6 * expected.rest);
    return true;
  }

  Draw draw;
  int coils;
  CoilWatch watch;
  Reference reference;
  MatrixXd faults, turned, healthy;
  ErrorMotion world{1};
  int coil = 1;
  double lack = 0, noise = 1;
  bool curved = false, directions = false, bounds = false;
};

// A coil fails after the tenth measurement or after the fiftieth. How many findings could be
// compared.
int compared_over_seeds(unsigned first, int seeds, void (*prepare)(Bench&)) {
  int compared = 0;
  for (unsigned seed = first; seed < first + seeds; ++seed) {
    Bench bench(seed, 1 + static_cast<int>(seed % 8));
    bench.coil = 1 + static_cast<int>(seed * 5) % bench.coils;
    prepare(bench);
    const double lack = bench.lack;
    for (int n = 0; n < 90; ++n) {
      bench.lack = n < (seed % 2 == 0 ? 10 : 50) ? 0 : lack;
      if (n % 23 == 17)
        bench.restart(0.1);
      else
        bench.step(bench.draw.between(0.04, 0.1));
      if (n % 9 == 3) compared += bench.compare() ? 1 : 0;
    }
  }
  return compared;
}

TEST(CoilWatchReference, gains_alone_and_straight_signatures) {
  EXPECT_GT(compared_over_seeds(1, 12, [](Bench& bench) { bench.lack = 0.4; }), 80);
}

TEST(CoilWatchReference, what_bounds_did_to_the_state_is_taken_out) {
  const auto prepare = [](Bench& bench) {
    bench.lack = 0.8;
    bench.bounds = true;
  };
  EXPECT_GT(compared_over_seeds(101, 12, prepare), 80);
}

TEST(CoilWatchReference, noise_that_is_larger_than_the_filter_says) {
  const auto prepare = [](Bench& bench) {
    bench.lack = 0.5;
    bench.noise = 3;
  };
  EXPECT_GT(compared_over_seeds(201, 12, prepare), 80);
}

TEST(CoilWatchReference, directions_too) {
  const auto prepare = [](Bench& bench) {
    bench.lack = 0.6;
    bench.directions = true;
    bench.bounds = true;
  };
  EXPECT_GT(compared_over_seeds(301, 12, prepare), 80);
}

TEST(CoilWatchReference, exchanged_leads) {
  const auto prepare = [](Bench& bench) { bench.lack = 2; };
  EXPECT_GT(compared_over_seeds(401, 12, prepare), 70);
}

TEST(CoilWatchReference, curved_signatures) {
  const auto prepare = [](Bench& bench) {
    bench.lack = 0.5;
    bench.curved = true;
    bench.directions = bench.coils % 2 == 0;
    bench.reference.by_newton = true;
  };
  EXPECT_GT(compared_over_seeds(501, 12, prepare), 80);
}

// Of 10 s and more, in a restless noise, so that no fault of the last seconds is likely.
TEST(CoilWatchReference, a_lack_since_ever_where_none_of_the_last_seconds_is_likely) {
  int compared = 0;
  for (unsigned seed = 601; seed <= 616; ++seed) {
    Bench bench(seed, 1 + static_cast<int>(seed % 8));
    bench.lack = 0.04 * (seed % 4);
    bench.noise = 2;
    bench.curved = bench.reference.by_newton = seed % 3 == 0;
    for (int n = 0; n < 70; ++n) {
      if (n % 30 == 17)
        bench.restart(0.1);
      else
        bench.step(bench.draw.between(0.15, 0.25));
      if (n > 45 && n % 3 == 0) compared += bench.compare() ? 1 : 0;
    }
  }
  EXPECT_GT(compared, 80);
}

// Spans that add up to the bounds of ages without rounding: each is a begin, or every second.
TEST(CoilWatchReference, begins_of_just_the_youngest_and_the_oldest_age) {
  for (const double span : {0.4, 0.2, 0.5, 0.25, 2.0, 4.0, 4.5}) {
    Bench bench(700 + static_cast<unsigned>(10 * span), 3);
    bench.lack = 0.3;
    bench.coil = 2;
    for (int n = 0; n < 45; ++n) {
      bench.step(span);
      bench.compare();
    }
  }
}

TEST(CoilWatchReference, nothing_is_known_before_the_first_begin_is_old_enough_or_after_a_reset) {
  Bench bench(801, 3), fresh(801, 3);
  for (Bench* one : {&bench, &fresh}) {
    one->lack = 0.5;
    one->bounds = true;
  }
  const auto expect_nothing = [&] {
    const Finding found = bench.watch.most_suspect();
    EXPECT_EQ(found.coil, 0);
    EXPECT_EQ(found.lack, 0);
    EXPECT_EQ(found.evidence, 0);
    EXPECT_EQ(found.next, 0);
    EXPECT_EQ(found.rest, 1);
  };
  expect_nothing();
  bench.restart(0.1);
  bench.restart(0.5);
  expect_nothing();
  for (int n = 0; n < 20; ++n) bench.step(0.3);
  EXPECT_GT(bench.watch.most_suspect().evidence, 0);
  bench.watch.reset();
  expect_nothing();
  for (int n = 0; n < 60; ++n) {
    fresh.step(0.25);
    const Step& step = fresh.reference.history.back();
    bench.watch.add(step.innovation, step.update, step.span, {step.faults.leftCols(3)});
    const Finding found = bench.watch.most_suspect(), expected = fresh.watch.most_suspect();
    EXPECT_EQ(found.coil, expected.coil);
    EXPECT_EQ(found.evidence, expected.evidence);
  }
}

TEST(CoilWatchReference, a_begin_of_one_innovation_only) {
  int compared = 0;
  for (unsigned seed = 901; seed <= 906; ++seed) {
    Bench bench(seed, 2);
    bench.noise = 10;
    bench.step(0.1);
    bench.restart(0.5);
    compared += bench.compare() ? 1 : 0;
  }
  EXPECT_GT(compared, 2);
}

// Two coils whose currents do the same can not be told from each other.
TEST(CoilWatchReference, coils_that_move_the_robot_alike_have_the_same_evidence) {
  Bench bench(802, 3);
  bench.lack = 0.5;
  CoilWatch alike(3);
  for (int n = 0; n < 30; ++n) {
    bench.step(0.1);
    const Step& step = bench.reference.history.back();
    CoilMotions::Columns given = step.faults.leftCols(3);
    given.col(1) = given.col(0);
    alike.add(step.innovation, step.update, step.span, {given});
  }
  const Finding found = alike.most_suspect();
  EXPECT_EQ(found.coil, 1);
  EXPECT_GT(found.evidence, 25);
  EXPECT_NEAR(found.evidence, found.next, 1e-6 * found.evidence);
}

// Since ever the coil has given as much too much as too little: no evidence, and nothing that hides
// what began a second ago.
TEST(CoilWatchReference, no_evidence_since_ever_hides_no_lack_of_the_last_seconds) {
  CoilWatch watch(1);
  EstimatorUpdate update;
  update.gain.topRows<3>().setIdentity();
  CoilMotions::Columns given(3, 1);
  given << 1e-5, 0, 0;
  Innovation innovation;
  innovation.covariance = 1e-10 * Eigen::Matrix3d::Identity();
  for (int n = 0; n < 120; ++n) {
    innovation.value = {n < 110 ? 1e-5 : -1.5e-5, 0, 0};
    watch.add(innovation, update, 0.1, {given});
  }
  const CoilWatch::Finding found = watch.most_suspect();
  EXPECT_EQ(found.coil, 1);
  EXPECT_GT(found.evidence, 15);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
