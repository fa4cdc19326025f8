// An enable line on a serial adapter as a rig file describes it: { driver = "serial_line", address
// = "serial:/dev/ttyUSB3", line = "rts" }.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/serial_line/driver.h"
#include "devices/links/address.h"
#include "host/rig/drivers/drivers.h"

namespace vitreo {
namespace {

/// Leads to the relay of the simulated laboratory's amplifiers.
class EmulatedLines final : public ModemLines {
 public:
  EmulatedLines(sim::Laboratory* laboratory, ModemLine used)
      : laboratory_(laboratory), used_(used) {}
  const std::string& address() const override { return address_; }
  void set(ModemLine line, bool asserted) override {
    if (laboratory_ != nullptr && line == used_) laboratory_->set_enable_line(asserted);
  }

 private:
  sim::Laboratory* const laboratory_;
  const ModemLine used_;
  const std::string address_ = "emulated";
};

}  // namespace

Opener<EnableLine> read_serial_line(const InstrumentReader& instrument) {
  serial_line::Settings settings;
  settings.name = instrument.role;
  settings.line = instrument.reader.choice("line", "rts", {"rts", "dtr"}) == "rts" ? ModemLine::rts
                                                                                   : ModemLine::dtr;
  if (instrument.emulated())
    return [settings](const RigContext& where) {
      return Opened<EnableLine>{
          nullptr, serial_line::open(
                       std::make_unique<EmulatedLines>(where.laboratory, settings.line), settings)};
    };
  const Address address = parse_address(instrument.address);
  if (address.bus != "serial")
    instrument.reader.fail("address", "must be a serial port, \"serial:/dev/ttyUSB0\"");
  return [settings, path = address.place](const RigContext& where) {
    return Opened<EnableLine>{nullptr,
                              serial_line::open(open_modem_lines(path, where.clock), settings)};
  };
}

}  // namespace vitreo
