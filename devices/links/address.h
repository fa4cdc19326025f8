// Address of an instrument, as a rig file writes it: "serial:/dev/ttyUSB0",
// "tcp:192.168.1.7:5025", "emulated".
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/event_link.h"
#include "devices/links/message_link.h"
#include "devices/links/serial_link.h"

#include <memory>
#include <string>

namespace vitreo {

struct Address {
  std::string bus;    ///< "serial", "tcp", "udp", "usb", "hid", "genicam", "emulated", ...
  std::string place;  ///< what stands after the colon; empty for "emulated"
};

/// Throws std::invalid_argument naming the address when there is no bus, or no place where the bus
/// wants one.
Address parse_address(const std::string& text);

/// For "serial:" and "tcp:"; `serial` only counts for the first. Throws std::invalid_argument for
/// another bus, and DeviceError as open_serial() and open_tcp() do.
std::unique_ptr<ByteLink> open_byte_link(const std::string& address, const SerialSettings& serial,
                                         Clock& clock);

/// Whether the address' bus carries whole messages: "udp:", "usbtmc:", "vxi11:", "hislip:".
bool carries_messages(const std::string& address);
/// For those. Throws std::invalid_argument for another bus, and for a place that is none of its;
/// DeviceError as the bus' own function does.
std::unique_ptr<MessageLink> open_message_link(const std::string& address, Clock& clock);

/// For "evdev:". Throws std::invalid_argument for another bus, else as open_evdev().
std::unique_ptr<EventLink> open_event_link(const std::string& address, Clock& clock);

}  // namespace vitreo
