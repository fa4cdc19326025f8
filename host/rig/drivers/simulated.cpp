// The simulated laboratory's own stages and field probe as a rig file describes them. The stages
// are Zaber's, driver and emulator, on a link without delay: axes that know where they are, as long
// and as fine as the file says.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/zaber/driver.h"
#include "devices/instruments/zaber/emulator.h"
#include "devices/time/error.h"
#include "host/rig/drivers/carried.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/serial.h"

#include <algorithm>
#include <random>

namespace vitreo {
namespace {

constexpr int kUsteps = zaber::EmulatedAxis{}.resolution;  // of a full step

// An address would be read and then ignored: better an error.
void only_emulated(const InstrumentReader& instrument) {
  if (!instrument.emulated()) instrument.reader.fail("address", "must be \"emulated\"");
}

// The laboratory owns the probe; an opener must give something that may be destroyed.
class BorrowedProbe : public FieldProbe {
 public:
  explicit BorrowedProbe(FieldProbe& probe) : probe_(probe) {}
  const FieldProbeInfo& info() const override { return probe_.info(); }
  FieldReading measure(Time timeout) override { return probe_.measure(timeout); }

 private:
  FieldProbe& probe_;
};

/// What flows in the simulated coils, with the noise and the time of an instrument.
class SimulatedSensor final : public CurrentSensor {
 public:
  SimulatedSensor(sim::Laboratory& laboratory, Clock& clock, double noise, double duration)
      : laboratory_(laboratory),
        clock_(clock),
        normal_(0, noise),
        duration_(from_seconds(duration)) {
    info_.identity = {"simulated current sensor", "", ""};
    for (int coil = 0; coil < laboratory.coils(clock.now()).currents.size(); ++coil)
      info_.coils.push_back(coil);
  }
  const CurrentSensorInfo& info() const override { return info_; }
  std::vector<double> measure(Time timeout) override {
    clock_.sleep_for(std::min(duration_, std::max(timeout, Time::zero())));
    if (duration_ > timeout)
      throw DeviceError(DeviceErrorKind::timeout, "current_sensor", "no answer in time");
    const control::Currents flowing = laboratory_.coils(clock_.now()).currents;
    std::vector<double> read(flowing.begin(), flowing.end());
    for (double& current : read) current += normal_(random_);
    return read;
  }

 private:
  sim::Laboratory& laboratory_;
  Clock& clock_;
  std::mt19937_64 random_{1};
  std::normal_distribution<double> normal_;
  const Time duration_;
  CurrentSensorInfo info_;
};

/// Defaults of an axis: m and m/s of a linear one, rad and rad/s of a rotary one.
struct Usual {
  double travel;
  double max_speed;
  double speed;
  double resolution;
};
constexpr Usual kSensor{15e-3, 20e-3, 5e-3, 1e-6};
constexpr Usual kProbe{20e-3, 20e-3, 10e-3, 5e-6};
constexpr Usual kTurntable{1e3, 3, 1, 1e-4};

// `resolution` is a microstep; Zaber's settings count full steps of kUsteps microsteps.
zaber::AxisSettings read_axis(ConfigReader& reader, const Usual& usual, double travel) {
  zaber::AxisSettings axis;
  axis.travel_min = -travel;
  axis.travel_max = travel;
  axis.max_speed = reader.number("max_speed", usual.max_speed, {1e-6, 10, ""});
  axis.speed = std::min(usual.speed, axis.max_speed);
  axis.step = reader.number("resolution", usual.resolution, {1e-9, 1e-2, ""}) * kUsteps;
  return axis;
}

/// One device an axis, each in the middle of its travel.
std::shared_ptr<zaber::Emulator> emulator_of(const zaber::Settings& settings) {
  std::vector<zaber::EmulatedDevice> chain;
  for (const zaber::AxisSettings& axis : settings.axes) {
    zaber::EmulatedAxis emulated;
    emulated.limit_max = axis.travel_max / axis.step * kUsteps;
    emulated.limit_min = -emulated.limit_max;
    chain.push_back({.address = axis.device, .axes = {emulated}});
  }
  return zaber::make_emulator(chain);
}

SerialPlace ideal_place() { return {"emulated", {.baud_rate = 115200}, true}; }

/// The true position of the axis in m or rad; `position` of the emulator is in microsteps.
double position_of(const zaber::Settings& settings, const zaber::Emulator& emulator,
                   std::size_t axis, Time time) {
  return emulator.position(axis, 0, time) * settings.axes[axis].step / kUsteps;
}

}  // namespace

Opener<Stage> read_simulated_stage(const InstrumentReader& instrument) {
  only_emulated(instrument);
  ConfigReader& reader = instrument.reader;
  const std::string load = read_load(instrument, "sensor");
  const Usual& usual = load == "probe" ? kProbe : kSensor;
  const double travel = reader.number("travel", usual.travel, {1e-6, 0.1, "m"});
  zaber::Settings settings;
  settings.name = instrument.role;
  settings.axes.clear();
  const zaber::AxisSettings each = read_axis(reader, usual, travel);
  // A sensor moves along the light alone; a probe is scanned through the workspace.
  for (const char* const name : {"x", "y", "z"}) {
    if (load != "probe" && std::string(name) != "z") continue;
    settings.axes.push_back(each);
    settings.axes.back().name = name;
    settings.axes.back().device = static_cast<int>(settings.axes.size());
  }
  check_settings(instrument, settings);
  return [settings, load](const RigContext& where) -> Opened<Stage> {
    const std::shared_ptr<zaber::Emulator> emulator = emulator_of(settings);
    carry(where, load, [settings, emulator](Time time) {
      if (settings.axes.size() == 1)
        return Eigen::Vector3d(0, 0, position_of(settings, *emulator, 0, time));
      return Eigen::Vector3d(position_of(settings, *emulator, 0, time),
                             position_of(settings, *emulator, 1, time),
                             position_of(settings, *emulator, 2, time));
    });
    let_stick(where, "stage", emulator);
    return open_on<Stage>(ideal_place(), emulator, where, "stage",
                          [&](std::unique_ptr<ByteLink> link) {
                            return zaber::open(std::move(link), settings, where.clock);
                          });
  };
}

Opener<RotationStage> read_simulated_rotation(const InstrumentReader& instrument) {
  only_emulated(instrument);
  zaber::Settings settings;
  settings.name = instrument.role;
  settings.axes = {read_axis(instrument.reader, kTurntable, kTurntable.travel)};
  settings.axes.front().name = "turn";
  check_settings(instrument, settings);
  return [settings](const RigContext& where) -> Opened<RotationStage> {
    const std::shared_ptr<zaber::Emulator> emulator = emulator_of(settings);
    where.laboratory->turn_sensor(
        [settings, emulator](Time time) { return position_of(settings, *emulator, 0, time); });
    let_stick(where, "rotation_stage", emulator);
    return open_on<RotationStage>(
        ideal_place(), emulator, where, "rotation_stage", [&](std::unique_ptr<ByteLink> link) {
          return zaber::open_rotary(std::move(link), settings, where.clock);
        });
  };
}

Opener<CurrentSensor> read_simulated_sensor(const InstrumentReader& instrument) {
  only_emulated(instrument);
  const double noise = instrument.reader.number("noise", 5e-3, {1e-9, 1, "A"});
  const double duration = instrument.reader.number("duration", 0.02, {1e-6, 1, "s"});
  return [noise, duration](const RigContext& where) -> Opened<CurrentSensor> {
    return {nullptr,
            std::make_unique<SimulatedSensor>(*where.laboratory, where.clock, noise, duration)};
  };
}

Opener<FieldProbe> read_simulated_probe(const InstrumentReader& instrument) {
  only_emulated(instrument);
  ConfigReader& reader = instrument.reader;
  sim::ProbeSettings& probe = instrument.laboratory.probe;
  probe.noise = reader.number("noise", probe.noise, {0, 1e-2, "T"});
  probe.range = reader.number("range", probe.range, {1e-6, 10, "T"});
  probe.integration = reader.number("integration", probe.integration, {0, 10, "s"});
  return [](const RigContext& where) -> Opened<FieldProbe> {
    return {nullptr, std::make_unique<BorrowedProbe>(where.laboratory->field_probe())};
  };
}

}  // namespace vitreo
