// The laboratory's instruments over the world they share.
// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/laboratory.h"

#include "devices/instruments/usb3103/driver.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

constexpr Time kMs = std::chrono::milliseconds(1);
const Eigen::Vector3d kNone = Eigen::Vector3d::Zero();

LaboratorySettings small() {
  LaboratorySettings settings;
  settings.top.size = {320, 240};
  settings.top_image.center_px = {159.5, 119.5};
  settings.side.size = {160, 120};
  settings.side_center_px = {79.5, 59.5};
  return settings;
}

TEST(Laboratory, FramesComeAtTheirRateWithTheirLatency) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  Camera& camera = laboratory.top_camera();
  const Frame first = camera.grab(kForever), second = camera.grab(kForever);
  EXPECT_EQ(first.received - first.exposed, 80 * kMs);
  EXPECT_NEAR(to_seconds(second.exposed - first.exposed), 1.0 / 15, 1e-8);
  clock->sleep_for(1001 * kMs);
  const Frame late = camera.grab(kForever);
  EXPECT_EQ(late.number, second.number + 15)
      << "only the newest is given; the gap shows in the numbers";
  EXPECT_LE(late.received, clock->now());
}

TEST(Laboratory, AnAmplifierThatIsCutOffGivesNoCurrentWhateverItIsTold) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  const auto now = [&] {
    clock->sleep_for(500 * kMs);
    return laboratory.coils(clock->now());
  };
  laboratory.drive_coils(clock->now(), std::vector<double>(8, 2.0));
  EXPECT_NEAR(now().currents[2], 2, 1e-3);
  laboratory.faults().cut_off = {3};
  laboratory.apply_coil_faults();
  CoilTruth coils = now();
  EXPECT_NEAR(coils.currents[2], 0, 1e-3) << "channels count from 1";
  EXPECT_NEAR(coils.currents[3], 2, 1e-3);
  EXPECT_EQ(coils.set_points[2], 2) << "what it was told";
  laboratory.faults().cut_off.clear();
  laboratory.apply_coil_faults();
  EXPECT_NEAR(now().currents[2], 2, 1e-3);
  laboratory.drive_coils(clock->now(), std::vector<double>(8, 0.0));
  coils = now();
  EXPECT_LT(coils.currents.cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_EQ(coils.set_points.cwiseAbs().maxCoeff(), 0);
}

TEST(Laboratory, AFrameThatDoesNotComeInTimeIsATimeout) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  laboratory.top_camera().grab(kForever);
  try {
    laboratory.top_camera().grab(10 * kMs);
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::timeout);
  }
}

TEST(Laboratory, TheRobotShowsOnlyWhenItIsIn) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  const cv::Mat empty = laboratory.top_camera().grab(kForever).image;
  EXPECT_FALSE(laboratory.truth(clock->now()));
  laboratory.sample().insert_robot(kNone);
  clock->sleep_for(150 * kMs);
  const cv::Mat with = laboratory.top_camera().grab(kForever).image;
  EXPECT_TRUE(laboratory.truth(clock->now()));
  EXPECT_GT(cv::norm(empty, with, cv::NORM_INF), 60);
}

TEST(Laboratory, TheReportedTruthCanBeShiftedWithoutChangingAPixel) {
  LaboratorySettings shifted = small();
  shifted.truth_shift = {0.5e-3, 0, 0};
  const auto clock = virtual_clock();
  Laboratory honest(small(), *clock, 1), lying(shifted, *clock, 1);
  honest.sample().insert_robot(kNone);
  lying.sample().insert_robot(kNone);
  clock->sleep_for(200 * kMs);
  EXPECT_EQ(cv::norm(honest.top_camera().grab(kForever).image,
                     lying.top_camera().grab(kForever).image, cv::NORM_INF),
            0);
  EXPECT_NEAR((lying.truth(clock->now())->position - honest.truth(clock->now())->position).x(),
              0.5e-3, 1e-12);
}

TEST(Laboratory, TheCoilsListenToTheirEmulatedSetPointDevice) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  laboratory.sample().insert_robot(kNone);
  auto coils =
      usb3103::open(memory_hid_link(laboratory.coil_outputs(), *clock, Time(0)), {}, *clock);
  coils->set_currents(std::vector<double>{1, -2, 3, 0, 0, 0, 0, 0.5});
  clock->sleep_for(400 * kMs);
  const auto flowing = laboratory.truth(clock->now())->currents;
  // half a count of the DAC is 0.3 mA through the amplifier's 2 A/V
  EXPECT_NEAR(flowing[0], 1, 1e-3);
  EXPECT_NEAR(flowing[1], -2, 1e-3);
  EXPECT_NEAR(flowing[7], 0.5, 1e-3);
}

TEST(Laboratory, TheLensMoverMovesTheImage) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  const cv::Mat before = laboratory.top_camera().grab(kForever).image;
  const auto lens =
      pololu_tic::open(memory_usb_link(laboratory.lens_motor(), *clock, Time(0)), {}, *clock);
  EXPECT_DOUBLE_EQ(lens->position(), 0);
  lens->move_to(2e-3, 10000 * kMs);
  EXPECT_DOUBLE_EQ(lens->position(), 2e-3);
  const cv::Mat after = laboratory.top_camera().grab(kForever).image;
  EXPECT_GT(cv::norm(before, after, cv::NORM_L1) / static_cast<double>(before.total()), 2)
      << "more than the noise alone";
}

TEST(Laboratory, TheSeedDrawsTheMachine) {
  const auto fall = [](std::uint64_t seed) {
    const auto clock = virtual_clock();
    Laboratory laboratory(small(), *clock, seed);
    laboratory.sample().insert_robot(kNone);
    return laboratory.truth(clock->now())->position;
  };
  EXPECT_EQ(fall(1), fall(1));
  EXPECT_NE(fall(1), fall(2));
}

TEST(Laboratory, AnotherRobotAndMediumComeIntoTheMachineThatWasDrawnLast) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  const auto made = [&] {
    laboratory.drive_coils(clock->now(), std::vector<double>(8, 1.0));
    clock->sleep_for(500 * kMs);
    return laboratory.field({1e-3, 0, 0}, clock->now());
  };
  const Eigen::Vector3d first = made();
  laboratory.redraw(7);
  const Eigen::Vector3d seventh = made();
  EXPECT_GT((seventh - first).norm(), 1e-3 * first.norm());
  laboratory.change(small().world.robot, std::nullopt);
  EXPECT_LT((made() - seventh).norm(), 1e-6 * seventh.norm());
}

TEST(Laboratory, AMeasuredFieldStaysAsItIsWhateverMachineIsDrawn) {
  const auto clock = virtual_clock();
  Laboratory laboratory(small(), *clock, 1);
  const control::CoilField measured = control::CoilField::octomag();
  const auto made = [&] {
    laboratory.drive_coils(clock->now(), std::vector<double>(8, 1.0));
    clock->sleep_for(500 * kMs);
    return laboratory.field({1e-3, 0, 0}, clock->now());
  };
  const Eigen::Vector3d told = measured.matrix({1e-3, 0, 0}).topRows<3>().rowwise().sum();
  EXPECT_GT((made() - told).norm(), 1e-3 * told.norm()) << "a machine is drawn";
  laboratory.use_field(measured);
  EXPECT_LT((made() - told).norm(), 1e-6 * told.norm());
  laboratory.redraw(7);
  EXPECT_LT((made() - told).norm(), 1e-6 * told.norm());
  const control::CoilField seven({measured.dipoles().begin(), measured.dipoles().begin() + 7});
  EXPECT_THROW(laboratory.use_field(seven), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
