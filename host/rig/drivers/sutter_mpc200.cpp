// The MPC-200 as a rig file describes it: { driver = "sutter_mpc200", address =
// "serial:/dev/ttyUSB0", drive = 1 }.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mpc200/driver.h"
#include "devices/instruments/sutter_mpc200/emulator.h"
#include "devices/instruments/sutter_mpc200/timing.h"
#include "host/rig/drivers/carried.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/serial.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo {
namespace {

/// Where the emulated drive stands when it is opened: in the middle of its travel, as a user left
/// it.
sutter_mpc200::EmulatorSettings middle_of(const sutter_mpc200::Settings& settings) {
  sutter_mpc200::EmulatorSettings emulated;
  emulated.connected.fill(true);
  for (std::size_t i = 0; i < 3; ++i) {
    const double middle = (settings.travel_min[i] + settings.travel_max[i]) / 2;
    emulated.start[i] = static_cast<std::int32_t>(std::lround(middle / sutter_mpc200::kUstep));
  }
  return emulated;
}

}  // namespace

// 0.338 mm/s is the slowest of the controller's speeds: below it no motion could be made. On a
// polled wire (`offer`) the emulator cannot measure the pause that the device wants before a
// straight motion, and so does not ask for it.
Opener<Stage> read_sutter_mpc200(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  const Bounds travel{0, 25e-3, "m"}, speed{0.338e-3, 5e-3, "m/s"};
  sutter_mpc200::Settings settings;
  settings.name = instrument.role;
  settings.drive = reader.integer("drive", settings.drive, 1, sutter_mpc200::kDrives);
  const auto read_travel = [&](const char* key, std::array<double, 3>& each) {
    const Eigen::Vector3d read = reader.vector3(key, {each[0], each[1], each[2]}, travel);
    each = {read.x(), read.y(), read.z()};
  };
  read_travel("travel_min", settings.travel_min);
  read_travel("travel_max", settings.travel_max);
  settings.max_speed = reader.number("max_speed", settings.max_speed, speed);
  settings.speed = reader.number("speed", std::min(settings.speed, settings.max_speed), speed);
  const SerialPlace place = read_serial_place(instrument, {.baud_rate = 128000});
  instrument.links.loads.push_back(
      {instrument.role, "a move", sutter_mpc200::move_time(place.baud_rate()), false, 0});
  const std::string load = read_load(instrument, "nothing");
  check_settings(instrument, settings);
  return [settings, place, load](const RigContext& where) {
    sutter_mpc200::EmulatorSettings emulated = middle_of(settings);
    if (where.offer) emulated.straight_pause = Time::zero();
    const std::shared_ptr<sutter_mpc200::Emulator> emulator =
        sutter_mpc200::make_emulator(emulated);
    if (place.emulated() || where.offer)
      carry(
          where, load,
          [emulator, start = emulated.start, drive = settings.drive](Time now) -> Eigen::Vector3d {
            const sutter_mpc200::Usteps at = emulator->position(drive, now);
            return Eigen::Vector3d(at[0] - start[0], at[1] - start[1], at[2] - start[2]) *
                   sutter_mpc200::kUstep;
          });
    return open_on<Stage>(place, emulator, where, "stage", [&](std::unique_ptr<ByteLink> link) {
      return sutter_mpc200::open(std::move(link), settings, where.clock);
    });
  };
}

}  // namespace vitreo
