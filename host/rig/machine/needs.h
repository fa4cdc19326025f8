// Needs of a rig: its instruments with an address outside the program, and which of the machine's
// devices each of them is.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/address.h"
#include "host/config/config.h"
#include "host/rig/machine/devices.h"

#include <optional>
#include <string>
#include <vector>

namespace vitreo::machine {

/// One address of a role; coils may have several.
struct Need {
  std::string role;
  std::string driver;
  Address address;
  double bytes_per_second = 0;  // of a camera's frames; 0: none, or not said
  int packet_size = 0;          // of a camera on the network, bytes
  int socket_buffer = 0;        // bytes
};

struct RigNeeds {
  std::string rig;  // its name or file, as a user gives it
  std::vector<Need> all;
  std::vector<std::string> warnings{};  // of what its file says (host/rig/measured_chain.h)
};

/// Emulated and recorded instruments need nothing. Opens nothing. Throws ConfigError.
RigNeeds needs_of(const RigDescription& description);

/// A device of the machine that Vitreo uses, or would.
struct Use {
  std::string name;                // the role; without a rig, what the device is
  std::string bus;                 // as an address begins: "serial", "hid", "usb", ...
  std::string node;                // what is opened: "/dev/hidraw0"; "": there is none
  const UsbDevice* usb = nullptr;  // null: not on USB
};

/// Of a rig: what its addresses name, as far as it is there. Without one: each instrument, serial
/// adapter and camera that is plugged in.
std::vector<Use> uses(const Machine& machine, const Devices& devices,
                      const std::optional<RigNeeds>& rig);

/// The devices that an address of a USB or HID instrument fits.
std::vector<const UsbDevice*> fitting(const Devices& devices, const Need& need);
/// The USB3 Vision camera that an address genicam:IDENTITY names; null: none, or it is no USB one.
const UsbDevice* usb_camera(const Devices& devices, const Need& need);

/// Whether a USB device is an adapter for serial lines, by its maker, or an instrument that is its
/// own adapter.
bool is_serial_adapter(const UsbIdentity& identity);

}  // namespace vitreo::machine
