// Kepco BOP supplies as a rig file describes them: { driver = "kepco_bop", address =
// "tcp:10.0.0.11:5025, tcp:..." }.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/driver.h"
#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/kepco_bop/timing.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/serial.h"
#include "host/rig/drivers/traced.h"

#include <sstream>

namespace vitreo {
namespace {

/// The emulators of all channels, and the currents of their coils, A.
struct EmulatedSupplies {
  std::vector<double> currents;
  std::vector<std::unique_ptr<kepco_bop::Emulator>> supplies;
};

// One supply a channel; each tells its own current, and the laboratory wants them all. `currents`
// lives as long as the supplies that write into it, for both are in one object. Without a
// laboratory the currents go nowhere.
std::shared_ptr<EmulatedSupplies> emulate(const RigContext& where,
                                          const kepco_bop::Settings& settings, int channels) {
  auto all = std::make_shared<EmulatedSupplies>();
  all->currents.resize(static_cast<std::size_t>(channels));
  kepco_bop::EmulatorSettings supply;
  supply.max_current = settings.current_limit;
  supply.max_voltage = settings.voltage_limit;
  for (std::size_t i = 0; i < all->currents.size(); ++i)
    all->supplies.push_back(kepco_bop::make_emulator(
        supply,
        [currents = &all->currents, i, laboratory = where.laboratory](Time now, double current) {
          (*currents)[i] = current;
          if (laboratory != nullptr) laboratory->drive_coils(now, *currents);
        }));
  return all;
}

/// In place of a link that did not open: every use of it fails as the opening did. So the driver
/// comes to the other supplies, which need their zero all the more.
class BrokenLink final : public ByteLink {
 public:
  explicit BrokenLink(const DeviceError& error) : error_(error) {}
  const std::string& address() const override { return error_.device; }
  void write(std::span<const std::uint8_t>, Time) override { throw error_; }
  ByteString read(std::size_t, Time) override { throw error_; }
  void reopen() override { throw error_; }

 private:
  const DeviceError error_;
};

std::unique_ptr<ByteLink> open_or_broken(const SerialPlace& place, Clock& clock) {
  try {
    return open_byte_link(place.address, place.serial, clock);
  } catch (const DeviceError& error) {
    return std::make_unique<BrokenLink>(error);
  }
}

/// One link a channel, counted from 1; to `emulated` where that is not null.
std::vector<std::unique_ptr<ByteLink>> links_of(const std::vector<SerialPlace>& places,
                                                EmulatedSupplies* emulated,
                                                const RigContext& where) {
  std::vector<std::unique_ptr<ByteLink>> links;
  for (std::size_t i = 0; i < places.size(); ++i) {
    auto link = emulated != nullptr
                    ? memory_byte_link(*emulated->supplies[i], where.clock, places[i].in_memory(),
                                       link_faults(where, "coils"))
                    : open_or_broken(places[i], where.clock);
    links.push_back(traced(where, "coils",
                           "channel " + std::to_string(i + 1) + ", " + places[i].address,
                           std::move(link)));
  }
  return links;
}

/// One address a channel, between commas; "emulated" means all eight of them.
std::vector<SerialPlace> read_places(const InstrumentReader& instrument) {
  std::vector<SerialPlace> places;
  std::istringstream addresses(instrument.address);
  for (std::string address; std::getline(addresses, address, ',');) {
    const std::size_t begin = address.find_first_not_of(' ');
    address = begin == std::string::npos ? "" : address.substr(begin);
    places.push_back(read_serial_place(
        {instrument.reader, instrument.role, address, instrument.laboratory, instrument.links},
        {.xon_xoff = true}));
    if (places.back().emulated() && !instrument.emulated())
      instrument.reader.fail("address", "must be \"emulated\" as a whole, or not at all");
  }
  if (instrument.emulated()) places.resize(8, places.front());
  return places;
}

/// The slowest of the channels counts: they are driven side by side.
void add_loads(const InstrumentReader& instrument, const kepco_bop::Settings& settings,
               const std::vector<SerialPlace>& places) {
  LinkTime update;
  for (const SerialPlace& place : places)
    if (const LinkTime one = kepco_bop::update_time(settings, place.baud_rate());
        update.arithmetic.empty() || one.seconds > update.seconds)
      update = one;
  instrument.links.loads.push_back({instrument.role, "a set point", update, true, 0});
  if (const std::string slow = kepco_bop::slow_ramp(settings, update); !slow.empty())
    instrument.links.warnings.push_back(instrument.role + ": " + slow);
}

}  // namespace

// All channels are emulated or none: a rig half of real and half of simulated coils would drive a
// field that no model has. {.xon_xoff = true} is the supplies' own flow control on RS-232. The far
// end is shared by all links and dies after the driver that talks to it.
Opener<CoilAmplifier> read_kepco_bop(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  kepco_bop::Settings settings;
  settings.name = instrument.role;
  settings.current_limit = reader.number("current_limit", settings.current_limit, {0.1, 20, "A"});
  settings.voltage_limit = reader.number("voltage_limit", settings.voltage_limit, {0.1, 200, "V"});
  settings.max_slope = reader.number("max_slope", settings.max_slope, {0.1, 1e5, "A/s"});
  settings.step_time = reader.number("step_time", settings.step_time, {1e-3, 1, "s"});
  settings.reply_timeout = reader.number("reply_timeout", settings.reply_timeout, {0.02, 5, "s"});
  settings.settling_time = reader.number("settling_time", settings.settling_time, {0.01, 10, "s"});
  settings.read_back_tolerance =
      reader.number("read_back_tolerance", settings.read_back_tolerance, {1e-3, 5, "A"});
  check_settings(instrument, settings);
  const std::vector<SerialPlace> places = read_places(instrument);
  add_loads(instrument, settings, places);
  return [settings, places](const RigContext& where) {
    Opened<CoilAmplifier> opened;
    std::shared_ptr<EmulatedSupplies> emulated;
    if (places.front().emulated() || where.offer)
      emulated = emulate(where, settings, static_cast<int>(places.size()));
    opened.far_end = emulated;
    if (where.offer) {
      for (std::size_t i = 0; i < places.size(); ++i)
        where.offer(places[i].address, places[i].baud_rate(),
                    {emulated, emulated->supplies[i].get()});
      return opened;
    }
    opened.device = kepco_bop::open(links_of(places, emulated.get(), where), settings, where.clock);
    return opened;
  };
}

}  // namespace vitreo
