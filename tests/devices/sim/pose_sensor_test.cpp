// The simulated pose sensor: late, noisy, and the same for the same seed.
// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/pose_sensor.h"

#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

std::optional<Eigen::Vector3d> moving(Time time) { return Eigen::Vector3d(to_seconds(time), 0, 0); }

TEST(PoseSensor, tells_where_the_robot_was_when_it_was_looked_at) {
  const auto clock = virtual_clock();
  const auto sensor = make_pose_sensor({15, 80e-3, 1e-9}, moving, *clock, 1);
  for (int n = 0; n < 5; ++n) {
    const PoseReading reading = sensor->read(from_seconds(1));
    EXPECT_EQ(reading.number, static_cast<std::uint64_t>(n));
    EXPECT_EQ(clock->now(), reading.received);
    EXPECT_NEAR(to_seconds(reading.received - reading.exposed), 80e-3, 1e-9);
    EXPECT_NEAR(reading.position->x(), to_seconds(reading.exposed), 1e-8);
  }
}

TEST(PoseSensor, is_as_noisy_as_it_says) {
  const auto clock = virtual_clock();
  const auto sensor = make_pose_sensor({100, 0, 4.3e-6}, moving, *clock, 3);
  double squares = 0;
  constexpr int kReadings = 2000;
  for (int n = 0; n < kReadings; ++n) {
    const PoseReading reading = sensor->read(from_seconds(1));
    squares += (*reading.position - *moving(reading.exposed)).squaredNorm();
    EXPECT_NEAR(std::sqrt(reading.covariance(2, 2)), 4.3e-6, 1e-12);
  }
  EXPECT_NEAR(std::sqrt(squares / (3 * kReadings)), 4.3e-6, 0.15e-6);
}

TEST(PoseSensor, gives_the_same_noise_for_the_same_seed_whatever_was_missed) {
  const auto first = virtual_clock(), second = virtual_clock();
  const auto patient = make_pose_sensor({15, 0.08, 1e-6}, moving, *first, 7),
             late = make_pose_sensor({15, 0.08, 1e-6}, moving, *second, 7);
  for (int n = 0; n < 8; ++n) patient->read(from_seconds(1));
  second->sleep_for(from_seconds(8.5 / 15 + 0.08));
  const PoseReading one = patient->read(from_seconds(1)), other = late->read(from_seconds(1));
  EXPECT_EQ(other.number, 8U);
  EXPECT_EQ(one.number, 8U);
  EXPECT_EQ(*one.position, *other.position);
  EXPECT_NE(*patient->read(from_seconds(1)).position - *one.position,
            Eigen::Vector3d(1 / 15.0, 0, 0));
}

TEST(PoseSensor, sees_no_robot_where_there_is_none_and_does_not_wait_for_ever) {
  const auto clock = virtual_clock();
  const auto sensor = make_pose_sensor(
      {}, [](Time) { return std::nullopt; }, *clock, 1);
  EXPECT_FALSE(sensor->read(from_seconds(1)).position);
  EXPECT_THROW(sensor->read(from_seconds(0.001)), DeviceError);
}

TEST(PoseSensor, refuses_settings_that_cannot_be) {
  EXPECT_THROW((PoseSensorSettings{0, 0.08, 1e-6}.check()), std::invalid_argument);
  EXPECT_THROW((PoseSensorSettings{15, 0.4, 1e-6}.check()), std::invalid_argument);
  EXPECT_THROW((PoseSensorSettings{15, 0.08, 0}.check()), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
