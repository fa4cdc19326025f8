// A SCPI teslameter as a rig file describes it: { driver = "scpi_probe", address =
// "tcp:10.0.0.7:7777", axes = 3 }.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_probe/driver.h"
#include "devices/instruments/scpi_probe/emulator.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/serial.h"

namespace vitreo {

Opener<FieldProbe> read_scpi_probe(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  scpi_probe::Settings settings;
  settings.name = instrument.role;
  settings.model = reader.text("model", settings.model);
  settings.question = reader.text("question", settings.question);
  settings.setup = reader.text("setup", settings.setup);
  settings.error_question = reader.text("error_question", settings.error_question);
  settings.pause = reader.number("pause", settings.pause, {0, 10, "s"});
  settings.axes = reader.integer("axes", 3, 1, 3);
  settings.unit = reader.number("unit", settings.unit, {1e-9, 10, "T"});
  settings.range = reader.number("range", settings.range, {1e-6, 50, "T"});
  check_settings(instrument, settings);
  const SerialPlace place = read_serial_place(instrument, {});
  // Position of an emulated probe in the simulated world, in which an emulated stage may carry it.
  const Eigen::Vector3d origin = reader.vector3("place", {0, 0, 0}, {-0.2, 0.2, "m"});
  const bool carried = reader.flag("on_stage", false);
  return [=](const RigContext& where) {
    // In the numbers of the instrument, whose unit is `unit` tesla; the driver multiplies again.
    const auto field = [settings, origin, carried, places = where.places,
                        laboratory = where.laboratory](Time now) {
      Eigen::Vector3d at = origin;
      if (carried && places->stage) at += places->stage(now);
      const Eigen::Vector3d tesla =
          laboratory == nullptr ? Eigen::Vector3d(0, 0, 0) : laboratory->field(at, now);
      // A probe of one axis measures along z.
      if (settings.axes == 1) return std::vector<double>{tesla.z() / settings.unit};
      return std::vector<double>{tesla.x() / settings.unit, tesla.y() / settings.unit,
                                 tesla.z() / settings.unit};
    };
    scpi_probe::EmulatorSettings emulated;
    emulated.question = settings.question;
    emulated.range = settings.range / settings.unit;
    if (!settings.model.empty()) emulated.identity = "VITREO," + settings.model + ",P001,1.0";
    return open_on<FieldProbe>(place, scpi_probe::make_emulator(emulated, field), where,
                               "field_probe", [&](std::unique_ptr<ByteLink> link) {
                                 return scpi_probe::open(std::move(link), settings, where.clock);
                               });
  };
}

}  // namespace vitreo
