// Shared parts of the readers of serial instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/address.h"
#include "devices/links/byte_link.h"
#include "devices/links/serial_line.h"
#include "host/rig/drivers/traced.h"
#include "host/rig/registry.h"

#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo {

/// Where the driver's bytes go: the address, and for a serial port its settings; or an emulator.
struct SerialPlace {
  std::string address;
  SerialSettings serial;
  bool ideal = false;  // its bytes take no time: TCP, or emulated without a baud rate
  bool emulated() const { return address == "emulated"; }
  /// As the drivers' arithmetic wants it: 0 where the bytes take no time.
  int baud_rate() const { return ideal ? 0 : serial.baud_rate; }
  /// Of a link in memory.
  MemoryLinkSettings in_memory() const {
    return {Time::zero(), ideal ? Time::zero() : character_time(serial)};
  }
};

/// Takes the std::invalid_argument of settings.check() for an error of the rig file.
template <class Settings>
void check_settings(const InstrumentReader& instrument, const Settings& settings) {
  try {
    settings.check();
  } catch (const std::invalid_argument& problem) {
    instrument.reader.fail("driver",
                           std::string("has settings that do not fit: ") + problem.what());
  }
}

/// Reads `baud_rate` (0 of an emulated one: its bytes take no time), `data_bits`, `parity`,
/// `stop_bits`, `flow` and `opening_lines`, none of them of "tcp:" addresses, and refuses an
/// address that carries no bytes. Of a line in memory the first four say how long a byte takes; it
/// has no flow control and no modem lines. `usual` holds what the instrument's manual says.
SerialPlace read_serial_place(const InstrumentReader& instrument, const SerialSettings& usual);

/// What is wrong with the wire to a role's emulators; null where nothing is simulated.
inline const LinkFaults* link_faults(const RigContext& where, const std::string& role) {
  return where.laboratory == nullptr ? nullptr : &where.laboratory->faults().links[role];
}

/// Opens the link, to `emulator` where the address says so, and `open`s the driver on it.
template <class Role, class Open>
Opened<Role> open_on(const SerialPlace& place, const std::shared_ptr<BytePeer>& emulator,
                     const RigContext& where, const std::string& role, const Open& open) {
  if (where.offer) {
    where.offer(place.address, place.baud_rate(), emulator);
    return {emulator, nullptr};
  }
  if (!place.emulated())
    return {nullptr, open(traced(where, role, place.address,
                                 open_byte_link(place.address, place.serial, where.clock)))};
  auto link = memory_byte_link(*emulator, where.clock, place.in_memory(), link_faults(where, role));
  // In this order: the driver's end still talks to the emulator.
  Opened<Role> opened;
  opened.far_end = emulator;
  opened.device = open(traced(where, role, place.address, std::move(link)));
  return opened;
}

}  // namespace vitreo
