// Search for plugged-in devices and the drivers that fit them: `vitreo devices`. Nothing is opened
// that could move by it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"
#include "devices/links/serial_ports.h"

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

namespace vitreo {

/// [{"bus", "address", "name", "place", "driver"}], driver empty where none would take it. A serial
/// port whose adapter does not say what is behind it has "candidates" instead: a question could
/// stop something, so none is asked; `vitreo devices --ask` does (host/rig/asking.h). Looking for
/// GenICam cameras takes a second. A bus that cannot be looked at is a row with "problem".
nlohmann::json find_instruments();

/// The driver that would take a USB or HID device; empty: none.
std::string driver_for(int vendor, int product);
/// The row of a driver's numbers that holds these; null: none.
const UsbKind* usb_kind(const Identification& identification, int vendor, int product);

/// The drivers that may take what is behind a serial port: one when the port's own USB identity
/// says so.
std::vector<std::string> drivers_for(const SerialPort& port);

}  // namespace vitreo
