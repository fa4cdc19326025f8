// Zaber stages as a rig file describes them: { driver = "zaber", address = "serial:...", x = {
// device = 1 }, z = {...}
// }.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/zaber/driver.h"
#include "devices/instruments/zaber/emulator.h"
#include "devices/instruments/zaber/timing.h"
#include "host/rig/drivers/carried.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/serial.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo {
namespace {

constexpr SerialSettings kSerial{.baud_rate = 115200};
constexpr double kTurn = 2 * std::numbers::pi;

/// The bounds that hold for a linear or a rotary axis.
struct Limits {
  Bounds travel, speed, step;
};
constexpr Limits kLinear{{-2, 2, "m"}, {1e-6, 1, "m/s"}, {1e-9, 1e-3, "m"}};
constexpr Limits kRotary{{-1e4, 1e4, "rad"}, {1e-4, 100, "rad/s"}, {1e-8, 0.1, "rad"}};

// A travel that is not given stays infinite: the instrument's own limits, read when it is opened,
// hold.
zaber::AxisSettings read_axis(ConfigReader& reader, zaber::AxisSettings axis,
                              const Limits& limits) {
  axis.device = reader.integer("device", axis.device, 1, 99);
  axis.axis = reader.integer("axis", axis.axis, 1, 9);
  axis.step = reader.number("step", axis.step, limits.step);
  if (reader.has("travel_min")) axis.travel_min = reader.number("travel_min", 0, limits.travel);
  if (reader.has("travel_max")) axis.travel_max = reader.number("travel_max", 0, limits.travel);
  axis.max_speed = reader.number("max_speed", axis.max_speed, limits.speed);
  axis.speed = reader.number("speed", std::min(axis.speed, axis.max_speed), limits.speed);
  if (reader.has("device_id")) axis.device_id = reader.integer("device_id", 0, 0, 999'999);
  return axis;
}

/// A chain that has the devices and axes of `settings`, each `travel` long (m or rad).
std::unique_ptr<zaber::Emulator> emulator_of(const zaber::Settings& settings, double travel) {
  std::vector<zaber::EmulatedDevice> chain;
  for (const zaber::AxisSettings& axis : settings.axes) {
    auto device = std::find_if(chain.begin(), chain.end(),
                               [&](const auto& one) { return one.address == axis.device; });
    if (device == chain.end())
      device = chain.insert(chain.end(), {.address = axis.device, .axes = {}});
    if (axis.device_id) device->device_id = *axis.device_id;
    zaber::EmulatedAxis emulated;
    emulated.limit_max = std::floor(travel / axis.step * emulated.resolution);
    if (static_cast<int>(device->axes.size()) < axis.axis)
      device->axes.resize(static_cast<std::size_t>(axis.axis));
    device->axes[static_cast<std::size_t>(axis.axis - 1)] = emulated;
  }
  return zaber::make_emulator(chain);
}

/// The true position of the axis number `index` of `settings`, in m or rad.
double axis_position(const zaber::Settings& settings, std::size_t index,
                     const zaber::Emulator& emulator, Time now) {
  // The emulator counts devices in the order in which the axes name them.
  std::vector<int> chain;
  for (const zaber::AxisSettings& axis : settings.axes)
    if (std::find(chain.begin(), chain.end(), axis.device) == chain.end())
      chain.push_back(axis.device);
  const zaber::AxisSettings& axis = settings.axes[index];
  const auto device =
      static_cast<std::size_t>(std::find(chain.begin(), chain.end(), axis.device) - chain.begin());
  return emulator.position(device, static_cast<std::size_t>(axis.axis - 1), now) * axis.step /
         zaber::EmulatedAxis{}.resolution;
}

}  // namespace

// Axes are devices 1, 2, ... of the chain in the order x, y, z unless the file numbers them.
Opener<Stage> read_zaber(const InstrumentReader& instrument) {
  zaber::Settings settings;
  settings.name = instrument.role;
  settings.axes.clear();
  for (const char* const name : {"x", "y", "z"}) {
    if (!instrument.reader.has(name)) continue;
    ConfigReader reader = instrument.reader.table(name);
    const int number = static_cast<int>(settings.axes.size()) + 1;
    settings.axes.push_back(read_axis(reader, {.name = name, .device = number}, kLinear));
    reader.finish();
  }
  if (settings.axes.empty())
    instrument.reader.fail("driver", "wants at least one of the tables x, y and z");
  check_settings(instrument, settings);
  const SerialPlace place = read_serial_place(instrument, kSerial);
  instrument.links.loads.push_back(
      {instrument.role, "a move", zaber::move_time(place.baud_rate()), false, 0});
  const std::string load = read_load(instrument, "nothing");
  return [settings, place, load](const RigContext& where) {
    const std::shared_ptr<zaber::Emulator> emulator = emulator_of(settings, 50e-3);
    if (place.emulated() || where.offer)
      carry(where, load, [settings, emulator](Time now) -> Eigen::Vector3d {
        Eigen::Vector3d moved(0, 0, 0);
        for (std::size_t i = 0; i < settings.axes.size(); ++i)
          moved[settings.axes[i].name.front() - 'x'] = axis_position(settings, i, *emulator, now);
        return moved;
      });
    if (place.emulated() || where.offer) let_stick(where, "stage", emulator);
    return open_on<Stage>(place, emulator, where, "stage", [&](std::unique_ptr<ByteLink> link) {
      return zaber::open(std::move(link), settings, where.clock);
    });
  };
}

Opener<RotationStage> read_zaber_rotary(const InstrumentReader& instrument) {
  zaber::Settings settings;
  settings.name = instrument.role;
  // An X-RSW60A: 76800 microsteps a turn.
  const zaber::AxisSettings usual{
      .name = "theta", .step = kTurn / 76800 * 64, .max_speed = 0.8, .speed = 0.2};
  settings.axes = {read_axis(instrument.reader, usual, kRotary)};
  check_settings(instrument, settings);
  const SerialPlace place = read_serial_place(instrument, kSerial);
  instrument.links.loads.push_back(
      {instrument.role, "a move", zaber::move_time(place.baud_rate()), false, 0});
  return [settings, place](const RigContext& where) {
    const std::shared_ptr<zaber::Emulator> emulator = emulator_of(settings, kTurn);
    if ((place.emulated() || where.offer) && where.laboratory != nullptr)
      where.laboratory->turn_sensor(
          [settings, emulator](Time now) { return axis_position(settings, 0, *emulator, now); });
    if (place.emulated() || where.offer) let_stick(where, "rotation_stage", emulator);
    return open_on<RotationStage>(
        place, emulator, where, "rotation_stage", [&](std::unique_ptr<ByteLink> link) {
          return zaber::open_rotary(std::move(link), settings, where.clock);
        });
  };
}

}  // namespace vitreo
