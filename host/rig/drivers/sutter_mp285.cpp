// The MP-285 as a rig file describes it: { driver = "sutter_mp285", address = "serial:/dev/ttyS0",
// speed = 1 * mm / s
// }.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mp285/driver.h"
#include "devices/instruments/sutter_mp285/emulator.h"
#include "devices/instruments/sutter_mp285/timing.h"
#include "host/rig/drivers/carried.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/serial.h"

#include <algorithm>
#include <array>

namespace vitreo {

// Positions count from the origin that a user has set on the controller, hence both signs. The
// emulator is made for a real port too, where it stays idle: open_on() takes one in any case.
Opener<Stage> read_sutter_mp285(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  const Bounds travel{-50e-3, 50e-3, "m"}, speed{1e-6, 3e-3, "m/s"};
  sutter_mp285::Settings settings;
  settings.name = instrument.role;
  const auto read_travel = [&](const char* key, std::array<double, 3>& each) {
    const Eigen::Vector3d read = reader.vector3(key, {each[0], each[1], each[2]}, travel);
    each = {read.x(), read.y(), read.z()};
  };
  read_travel("travel_min", settings.travel_min);
  read_travel("travel_max", settings.travel_max);
  settings.max_speed = reader.number("max_speed", settings.max_speed, speed);
  settings.speed = reader.number("speed", std::min(settings.speed, settings.max_speed), speed);
  settings.opening_pause = reader.number("opening_pause", settings.opening_pause, {0, 10, "s"});
  settings.reply_timeout = reader.number("reply_timeout", settings.reply_timeout, {0.02, 60, "s"});
  const SerialPlace place = read_serial_place(instrument, {});
  instrument.links.loads.push_back(
      {instrument.role, "a move", sutter_mp285::move_time(place.baud_rate()), false, 0});
  const std::string load = read_load(instrument, "nothing");
  check_settings(instrument, settings);
  return [settings, place, load](const RigContext& where) {
    const std::shared_ptr<sutter_mp285::Emulator> emulator = sutter_mp285::make_emulator();
    if (place.emulated() || where.offer)
      carry(where, load, [emulator](Time now) -> Eigen::Vector3d {
        const sutter_mp285::Usteps usteps = emulator->position(now);
        return Eigen::Vector3d(usteps[0], usteps[1], usteps[2]) * sutter_mp285::kUstep;
      });
    return open_on<Stage>(place, emulator, where, "stage", [&](std::unique_ptr<ByteLink> link) {
      return sutter_mp285::open(std::move(link), settings, where.clock);
    });
  };
}

}  // namespace vitreo
