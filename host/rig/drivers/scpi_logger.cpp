// A data logger that measures the coils' currents as a rig file describes it: { driver =
// "scpi_logger", address = "tcp:10.0.0.8:5025", channels = { 101, 102 }, amperes_per_volt = { 10 }
// }.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_logger/driver.h"
#include "devices/instruments/scpi_logger/emulator.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/serial.h"

#include <cmath>

namespace vitreo {
namespace {

/// `channels`, one a coil; `coils` which (1, 2, ...); `amperes_per_volt` of each, or of all.
std::vector<scpi_logger::SensedCoil> read_sensed_coils(ConfigReader& reader) {
  const std::vector<double> channels = reader.numbers("channels", {}, {101, 399, ""});
  if (channels.empty()) reader.fail("channels", "must list a channel for each coil: { 101, 102 }");
  std::vector<double> usual;
  for (std::size_t i = 0; i < channels.size(); ++i) usual.push_back(static_cast<double>(i + 1));
  const std::vector<double> coils = reader.numbers("coils", usual, {1, control::kMaxCoils, ""});
  const std::vector<double> gains = reader.numbers("amperes_per_volt", {1}, {-1e4, 1e4, ""});
  if (coils.size() != channels.size())
    reader.fail("coils", "must have as many numbers as channels has");
  if (gains.size() != channels.size() && gains.size() != 1)
    reader.fail("amperes_per_volt", "must have as many numbers as channels has, or one for all");
  std::vector<scpi_logger::SensedCoil> sensed;
  for (std::size_t i = 0; i < channels.size(); ++i) {
    if (channels[i] != std::floor(channels[i])) reader.fail("channels", "wants whole numbers");
    if (coils[i] != std::floor(coils[i])) reader.fail("coils", "wants whole numbers, from 1");
    sensed.push_back({static_cast<int>(coils[i]) - 1, static_cast<int>(channels[i]),
                      gains.size() == 1 ? gains[0] : gains[i]});
  }
  return sensed;
}

/// V of the shunt that the channel is on, in the simulated laboratory.
double emulated_volts(const scpi_logger::Settings& settings, sim::Laboratory* laboratory,
                      int channel, Time now) {
  if (laboratory == nullptr) return 0;
  const control::Currents flowing = laboratory->coils(now).currents;
  for (const scpi_logger::SensedCoil& one : settings.coils)
    if (one.channel == channel && one.coil < flowing.size())
      return flowing[one.coil] / one.amperes_per_volt;
  return 0;
}

}  // namespace

Opener<CurrentSensor> read_scpi_logger(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  scpi_logger::Settings settings;
  settings.name = instrument.role;
  settings.model = reader.text("model", settings.model);
  settings.coils = read_sensed_coils(reader);
  settings.range = reader.number("range", settings.range, {0.01, 300, ""});
  settings.line_cycles = reader.number("line_cycles", settings.line_cycles, {0.02, 10, ""});
  settings.reply_timeout = reader.number("reply_timeout", settings.reply_timeout, {1e-3, 30, "s"});
  check_settings(instrument, settings);
  // The factory setting of a 34970A, from memory: its panel shows what is set.
  const SerialPlace place = read_serial_place(instrument, {.baud_rate = 57600, .xon_xoff = true});
  return [=](const RigContext& where) {
    scpi_logger::EmulatorSettings emulated;
    if (!settings.model.empty()) emulated.identity = "VITREO," + settings.model + ",L001,1.0";
    const auto volts = [settings, laboratory = where.laboratory](int channel, Time now) {
      return emulated_volts(settings, laboratory, channel, now);
    };
    return open_on<CurrentSensor>(place, scpi_logger::make_emulator(emulated, volts), where,
                                  "current_sensor", [&](std::unique_ptr<ByteLink> link) {
                                    return scpi_logger::open(std::move(link), settings,
                                                             where.clock);
                                  });
  };
}

}  // namespace vitreo
