// The servo law and the tuning; then the whole of control/ in a small simulated laboratory, with
// the figures.
// SPDX-License-Identifier: Apache-2.0
#include "control/servo_law.h"

#include "tests/control/simulated_loop.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <stdexcept>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr int kMachines = 8;  // draws of field and moment, as the drift study's

struct Figures {
  double median = 0, worst = 0;
};

// rms errors over the draws, printed in micrometers.
template <typename Run>
Figures over_machines(const char* name, const LoopSetting& setting, const Run& run) {
  std::vector<double> errors;
  for (int machine = 1; machine <= kMachines; ++machine) {
    LoopSetting drawn = setting;
    drawn.seed = static_cast<unsigned long long>(machine);
    SimulatedLoop loop(drawn);
    errors.push_back(run(loop));
  }
  std::sort(errors.begin(), errors.end());
  const Figures figures{(errors[kMachines / 2 - 1] + errors[kMachines / 2]) / 2, errors.back()};
  std::printf("  %-44s median %6.2f um rms, worst %6.2f um\n", name, 1e6 * figures.median,
              1e6 * figures.worst);
  return figures;
}

const Trajectory& hold() {
  static const Trajectory path = Trajectory::hold_at({2e-3, 0, 1e-3});
  return path;
}

const Trajectory& square() {  // the thesis' 8 mm x 6 mm at the 0.5 mm/s
  static const Trajectory path =
      Trajectory::rectangle({-4e-3, 0, -3e-3}, {8e-3, 0, 0}, {0, 0, 6e-3}, {});
  return path;
}

double held(SimulatedLoop& loop, bool estimate) { return loop.run(hold(), estimate, 10, 40).rms; }
double around(SimulatedLoop& loop, bool estimate) {
  return loop.run(square(), estimate, 2, square().duration()).rms;
}

TEST(ServoVelocity,
     is_reference_and_feedback_less_the_disturbance_and_only_the_feedback_is_limited) {
  PositionEstimate estimate;
  estimate.position = {1e-3, 0, 0};
  estimate.disturbance = {0, 1e-4, 0};
  const Reference reference{{1.1e-3, 0, 0}, {0, 0, 2e-4}};
  const ServoGains gains{2, 1e-3};
  EXPECT_LT(
      (servo_velocity(gains, reference, estimate) - Eigen::Vector3d(2e-4, -1e-4, 2e-4)).norm(),
      1e-18);
  EXPECT_LT((servo_velocity({100, 1e-3}, reference, estimate) - Eigen::Vector3d(1e-3, -1e-4, 2e-4))
                .norm(),
            1e-15);
  EXPECT_THROW(servo_velocity({-1, 1e-3}, reference, estimate), std::invalid_argument);
  EXPECT_THROW(servo_velocity({1, 0}, reference, estimate), std::invalid_argument);
}

TEST(ServoVelocity, divides_by_the_gain_and_less_boldly_where_it_is_uncertain) {
  PositionEstimate estimate;
  const Reference reference{{0, 0, 0}, {1e-3, 0, 0}};
  estimate.gain = -0.5;
  EXPECT_NEAR(servo_velocity({2, 1e-3}, reference, estimate).x(), 2e-3, 1e-15);
  estimate.gain_sigma = 0.5;  // as uncertain as it is large: half
  EXPECT_NEAR(servo_velocity({2, 1e-3}, reference, estimate).x(), 1e-3, 1e-15);
}

TEST(Schedule, is_slower_the_less_is_known_and_never_faster_than_its_margins) {
  const ServoTuning tuning = tune({});
  PositionEstimate known, doubted;
  doubted.gain_sigma = 0.3;
  doubted.delay_sigma = 30e-3;
  const ServoChanges still, moving{0.5e-3, 0}, wild{0, 1};
  EXPECT_LT(schedule(tuning, known, still).bandwidth, schedule(tuning, known, moving).bandwidth);
  EXPECT_LT(schedule(tuning, doubted, moving).bandwidth, schedule(tuning, known, moving).bandwidth);
  EXPECT_LT(schedule(tuning, doubted, still).proportional,
            schedule(tuning, known, still).proportional);
  // However large a change: 1 / T, at which the gain margin is above 6 dB.
  EXPECT_NEAR(schedule(tuning, known, wild).bandwidth, 1 / tuning.loop.dead_time(), 1e-9);
}

TEST(Tune, asks_for_less_gain_where_the_loop_is_later_and_for_less_speed_where_the_drag_is_higher) {
  LoopIdentity quick, slow;
  quick.measurement_latency = 0.01;
  slow.drag = 2 * quick.drag;
  EXPECT_GT(tune(quick).gains.proportional, tune(slow).gains.proportional);
  EXPECT_GT(tune(quick).pd.proportional, tune(slow).pd.proportional);
  EXPECT_NEAR(tune(quick).gains.max_speed, 2 * tune(slow).gains.max_speed, 1e-12);
  EXPECT_NO_THROW(tune(quick).estimator.check());
  EXPECT_NO_THROW(tune(quick).pd.check());
  for (double LoopIdentity::*parameter :
       {&LoopIdentity::period, &LoopIdentity::noise, &LoopIdentity::drag}) {
    LoopIdentity bad;
    bad.*parameter = 0;
    EXPECT_THROW(tune(bad), std::invalid_argument);
  }
}

TEST(ClosedLoop,
     holds_within_six_micrometers_at_fifteen_frames_where_the_thesis_law_needs_a_hundred) {
  const auto pd =
      over_machines("15 fps, hold, PD", {}, [](auto& loop) { return held(loop, false); });
  const auto full =
      over_machines("15 fps, hold, estimator", {}, [](auto& loop) { return held(loop, true); });
  EXPECT_LT(full.worst, 6e-6);              // the goal; measured: 4.3, worst 4.6
  EXPECT_LT(full.median, 0.2 * pd.median);  // measured: a twenty-fifth
}

TEST(ClosedLoop, follows_the_square_within_fifteen_micrometers) {
  const auto pd = over_machines("15 fps, square at 0.5 mm/s, PD", {},
                                [](auto& loop) { return around(loop, false); });
  const auto full =
      over_machines("15 fps, square, estimator", {}, [](auto& loop) { return around(loop, true); });
  EXPECT_LT(full.worst,
            15e-6);  // the goal, of every machine; measured: 10.4, and 5.6 in the median
  EXPECT_LT(full.median, pd.median);
}

TEST(ClosedLoop, holds_within_a_micrometer_at_two_hundred_frames) {
  const LoopSetting fast{200, 0.008, 0, 1 / (2 * std::numbers::pi * 50), 0.1 * 5e-6};
  const auto pd =
      over_machines("200 fps, hold, PD", fast, [](auto& loop) { return held(loop, false); });
  const auto full =
      over_machines("200 fps, hold, estimator", fast, [](auto& loop) { return held(loop, true); });
  EXPECT_LT(full.worst, 1e-6);  // the goal; measured: 0.31
  EXPECT_LT(full.median, pd.median);
}

TEST(ClosedLoop, holds_with_a_third_of_the_measurements_missing) {
  LoopSetting setting;
  setting.missing = 0.3;
  const auto full = over_machines("15 fps, 30 % missing, hold, estimator", setting,
                                  [](auto& loop) { return held(loop, true); });
  EXPECT_LT(full.worst, 10e-6);  // a fifth more noise than with all of them, and room
}

TEST(ClosedLoop, is_not_upset_by_a_wrongly_identified_latency) {
  for (const double error : {-0.03, 0.03}) {
    const auto full = over_machines("15 fps, delay wrong by 30 ms, hold", {}, [&](auto& loop) {
      loop.identity().command_delay += error;
      return held(loop, true);
    });
    EXPECT_LT(full.worst, 8e-6);  // half a frame of error costs phase, not stability
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
