// The laboratory's field probe, and a calibration of the coils with it on a driver's stage over its
// emulator.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_fit.h"
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/zaber/driver.h"
#include "devices/instruments/zaber/emulator.h"
#include "devices/sim/laboratory.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <array>

namespace vitreo::sim {
namespace VITREO_TEST_FILE {

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
  auto coils =
      usb3103::open(memory_hid_link(laboratory.coil_outputs(), *clock, Time(0)), {}, *clock);
  // Three axes of 50 mm, 1 um a microstep; the middle of the workspace is the middle of their
  // travel.
  constexpr double kMiddle = 25e-3, kStep = 1e-6;
  const auto motors = zaber::make_emulator({{.address = 1, .axes = {{.limit_max = 50e3}}},
                                            {.address = 2, .axes = {{.limit_max = 50e3}}},
                                            {.address = 3, .axes = {{.limit_max = 50e3}}}});
  zaber::Settings axes;
  axes.axes.clear();
  for (int k = 0; k < 3; ++k)
    axes.axes.push_back(
        {.name = std::string(1, static_cast<char>('x' + k)), .device = k + 1, .step = 64 * kStep});
  const auto stage = zaber::open(memory_byte_link(*motors, *clock), axes, *clock);
  laboratory.carry_probe([&](Time time) {
    const Eigen::Vector3d at(motors->position(0, 0, time), motors->position(1, 0, time),
                             motors->position(2, 0, time));
    return Eigen::Vector3d(at * kStep - Eigen::Vector3d::Constant(kMiddle));
  });
  std::vector<control::ProbeReading> readings;
  for (int place = 0; place < 9; ++place) {
    const std::array at{(place & 1) != 0 ? 8e-3 : -8e-3, (place & 2) != 0 ? 8e-3 : -8e-3,
                        place == 8         ? 0
                        : (place & 4) != 0 ? 8e-3
                                           : -8e-3};
    move_to(*stage, std::array{at[0] + kMiddle, at[1] + kMiddle, at[2] + kMiddle}, 10e-3, kForever,
            *clock);
    for (int coil = 0; coil < 8; ++coil) {
      control::Currents currents = control::Currents::Zero(8);
      currents[coil] =
          place % 2 == 0 ? 8 : -8;  // either sign, or the background could not be told from them
      coils->set_currents(std::vector<double>(currents.begin(), currents.end()));
      clock->sleep_for(400 * kMs);
      const FieldReading reading = laboratory.field_probe().measure(kForever);
      readings.push_back({{at[0], at[1], at[2]},
                          currents,
                          {reading.field[0], reading.field[1], reading.field[2]}});
    }
  }
  const control::DipoleFit fit = control::fit_dipoles(control::CoilField::octomag(), readings);
  EXPECT_TRUE(fit.converged);
  // the probe's 10 uT and the outputs' 0.6 mA a count; what the model lacked before was 6 %
  EXPECT_LT(fit.residual_rms, 20e-6);
  EXPECT_LT(fit.residual_relative, 3e-3);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sim
