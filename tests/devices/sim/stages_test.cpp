// The laboratory's own stages and field probe, and a calibration of the coils with them.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_fit.h"
#include "devices/error.h"
#include "devices/sim/laboratory.h"
#include "devices/usb3103/driver.h"

#include <gtest/gtest.h>

#include <array>

namespace vitreo::sim {
namespace {

constexpr Time kMs = std::chrono::milliseconds(1);

template <typename Action>
DeviceErrorKind kind_of(Action action) {
  try {
    action();
  } catch (const DeviceError& error) {
    return error.kind;
  }
  ADD_FAILURE() << "nothing was thrown";
  return DeviceErrorKind::lost;
}

TEST(SimulatedStage, ItTakesItsTimeAndArrivesOnItsResolution) {
  const auto clock = virtual_clock();
  Laboratory laboratory({}, *clock, 1);
  Stage& stage = laboratory.probe_stage();
  stage.start(std::array{4e-3, -2e-3, 1.0021e-3}, 2e-3);
  EXPECT_TRUE(stage.moving());
  clock->sleep_for(1000 * kMs);
  EXPECT_NEAR(stage.position()[0], 2e-3, 1e-9);
  EXPECT_NEAR(stage.position()[1], -1e-3, 1e-9);
  stage.wait(kForever);
  EXPECT_EQ(clock->now(), 2000 * kMs);
  EXPECT_NEAR(stage.position()[2], 1.0e-3, 1e-12) << "5 um steps";
}

TEST(SimulatedStage, BadMotionsAreRefusedAndTimeoutsStopIt) {
  const auto clock = virtual_clock();
  Laboratory laboratory({}, *clock, 1);
  Stage& stage = laboratory.sensor_stage();
  EXPECT_EQ(kind_of([&] { stage.start(std::array{1.0}, 1e-3); }), DeviceErrorKind::refused);
  EXPECT_THROW(stage.start(std::array{1e-3, 0.0}, 1e-3), std::invalid_argument);
  EXPECT_EQ(kind_of([&] { stage.home(kForever); }), DeviceErrorKind::refused);
  stage.start(std::array{10e-3}, 1e-3);
  EXPECT_EQ(kind_of([&] { stage.start(std::array{0.0}, 1e-3); }), DeviceErrorKind::refused);
  EXPECT_EQ(kind_of([&] { stage.wait(2000 * kMs); }), DeviceErrorKind::timeout);
  EXPECT_FALSE(stage.moving());
  EXPECT_NEAR(stage.position()[0], 2e-3, 1e-9);
  stage.start(std::array{0.0}, 1e-3);
  stage.make_safe();
  EXPECT_EQ(kind_of([&] { stage.wait(kForever); }), DeviceErrorKind::refused);
}

TEST(SimulatedProbe, ItRefusesWhatIsBeyondItsRange) {
  LaboratorySettings settings;
  settings.probe.range = 1e-6;
  settings.world.field.set_uniform_background({0, 0, 50e-6});
  const auto clock = virtual_clock();
  Laboratory laboratory(settings, *clock, 1);
  EXPECT_EQ(kind_of([&] { laboratory.field_probe().measure(kForever); }), DeviceErrorKind::refused);
  EXPECT_EQ(kind_of([&] { laboratory.field_probe().measure(1 * kMs); }), DeviceErrorKind::timeout);
}

TEST(SimulatedProbe, TheCoilsCanBeCalibratedThroughTheInstrumentsAlone) {
  const auto clock = virtual_clock();
  LaboratorySettings settings;
  settings.world.coils.noise = 0;
  Laboratory laboratory(settings, *clock, 5);
  auto coils = usb3103::open(memory_hid_link(laboratory.coil_outputs(), *clock, Time(0)), {}, *clock);
  std::vector<control::ProbeReading> readings;
  for (int place = 0; place < 9; ++place) {
    const std::array at{(place & 1) != 0 ? 8e-3 : -8e-3, (place & 2) != 0 ? 8e-3 : -8e-3,
                        place == 8         ? 0
                        : (place & 4) != 0 ? 8e-3
                                           : -8e-3};
    move_to(laboratory.probe_stage(), at, 10e-3, kForever, *clock);
    for (int coil = 0; coil < 8; ++coil) {
      control::Currents currents = control::Currents::Zero(8);
      currents[coil] = place % 2 == 0 ? 8 : -8;  // either sign, or the background could not be told from them
      coils->set_currents(std::vector<double>(currents.begin(), currents.end()));
      clock->sleep_for(400 * kMs);
      const FieldReading reading = laboratory.field_probe().measure(kForever);
      readings.push_back({{at[0], at[1], at[2]}, currents, {reading.field[0], reading.field[1], reading.field[2]}});
    }
  }
  const control::DipoleFit fit = control::fit_dipoles(control::CoilField::octomag(), readings);
  EXPECT_TRUE(fit.converged);
  // the probe's 10 uT and the outputs' 0.6 mA a count; what the model lacked before was 6 %
  EXPECT_LT(fit.residual_rms, 20e-6);
  EXPECT_LT(fit.residual_relative, 3e-3);
}

}  // namespace
}  // namespace vitreo::sim
