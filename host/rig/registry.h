// Registry of drivers: from { driver = "zaber", address = "serial:/dev/ttyUSB0", ... } in a rig
// file to an instrument.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/identification.h"
#include "devices/links/link_tap.h"
#include "devices/links/usb_address.h"
#include "devices/roles/camera.h"
#include "devices/roles/coil_amplifier.h"
#include "devices/roles/current_sensor.h"
#include "devices/roles/enable_line.h"
#include "devices/roles/field_probe.h"
#include "devices/roles/instrument.h"
#include "devices/roles/lamp.h"
#include "devices/roles/lens_mover.h"
#include "devices/roles/operator_input.h"
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "devices/sim/laboratory.h"
#include "devices/time/clock.h"
#include "host/config/config.h"
#include "host/rig/link_load.h"
#include "host/rig/opening_error.h"

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

/// What a driver's settings are read from.
struct InstrumentReader {
  ConfigReader& reader;                 // the role's table; driver and address are read already
  std::string role;                     // how errors call the instrument
  std::string address;                  // "emulated", or as devices/links/address.h says
  sim::LaboratorySettings& laboratory;  // what an emulated instrument acts on
  LinkLoads& links;                     // to which it adds what its commands cost
  bool emulated() const { return address == "emulated"; }
};

/// How far the emulated stage has really moved, in m and the world's axes; empty where there is
/// none.
struct SimulatedPlaces {
  std::function<Eigen::Vector3d(Time)> stage;
};

/// An instrument whose driver is exchanged while others hold it (host/rig/drivers/reloadable.h).
class Reloadable {
 public:
  virtual ~Reloadable() = default;
  /// Reads its file anew, makes the instrument safe, closes its link and opens it by what the file
  /// says now. Throws ConfigError where the file is wrong, DeviceError{refused} during a call: then
  /// nothing has changed; DeviceError where it does not open: then it is open as before, or, where
  /// that cannot be either, closed. Returns the file as it is now.
  virtual RigSource reload() = 0;
  /// Whether it may heat, drive, burn or move.
  virtual bool in_use() = 0;
};

/// Where an instrument is opened.
struct RigContext {
  Clock& clock;
  sim::Laboratory* laboratory;  // null where nothing is simulated
  /// Shared with the emulators that stand on a stage, which outlive this. Stages are opened before
  /// what they carry.
  std::shared_ptr<SimulatedPlaces> places = std::make_shared<SimulatedPlaces>();
  /// Where only the far ends are wanted: it is given the emulator of each instrument that talks
  /// bytes, with the address and the baud rate of the rig file (0: its bytes take no time); the
  /// instrument itself is not opened. Empty: everything is.
  std::function<void(const std::string& address, int baud_rate, std::shared_ptr<BytePeer>)> offer{};
  /// The rig as resolved, for errors; null: not known. It and the tap outlive the instruments.
  const nlohmann::json* rig = nullptr;
  LinkTap* tap = nullptr;  ///< sees what passes on every link; null: none does
  /// Gets those that can be reloaded, by role; they outlive it. Null: nobody asks.
  std::map<std::string, Reloadable*>* reloadable = nullptr;
};

/// An instrument and, when it is emulated, what stands at the far end of its link. They die in the
/// right order.
template <class Role>
struct Opened {
  std::shared_ptr<void> far_end{};  // shared only to forget its type
  std::unique_ptr<Role> device{};
};

/// Opens the instrument: throws DeviceError. Nothing has touched it before.
template <class Role>
using Opener = std::function<Opened<Role>(const RigContext&)>;

/// The same, but that a DeviceError names the role, and what the rig knows (opening_error.h).
template <class Role>
Opener<Role> explained(const InstrumentReader& instrument, Opener<Role> opener) {
  return [role = instrument.role, address = instrument.address,
          open = std::move(opener)](const RigContext& where) {
    try {
      return open(where);
    } catch (const DeviceError& error) {
      throw opening_error(error, role, address, where.rig);
    }
  };
}

/// One line of the registry. `read` takes the instrument's own settings with their bounds; it
/// throws ConfigError. `identification` tells how one is found that is plugged in; null where a
/// search of its own finds it (cameras), or nothing does.
template <class Role>
struct DriverEntry {
  const char* name;
  Opener<Role> (*read)(const InstrumentReader&);
  Identification (*identification)() = nullptr;
};

/// All that can play the role; the first one is taken when a rig file names none, but for a pedal
/// (rig_settings.cpp).
template <class Role>
const std::vector<DriverEntry<Role>>& drivers();
template <>
const std::vector<DriverEntry<CoilAmplifier>>& drivers();
template <>
const std::vector<DriverEntry<LensMover>>& drivers();
template <>
const std::vector<DriverEntry<OperatorInput>>& drivers();
/// Of real cameras; the simulated one is the laboratory's own.
template <>
const std::vector<DriverEntry<Camera>>& drivers();
template <>
const std::vector<DriverEntry<Stage>>& drivers();
template <>
const std::vector<DriverEntry<RotationStage>>& drivers();
template <>
const std::vector<DriverEntry<FieldProbe>>& drivers();
template <>
const std::vector<DriverEntry<Lamp>>& drivers();
template <>
const std::vector<DriverEntry<EnableLine>>& drivers();
template <>
const std::vector<DriverEntry<CurrentSensor>>& drivers();
/// Empty: instruments of free kinds are Lua files.
template <>
const std::vector<DriverEntry<Instrument>>& drivers();

/// A driver by its name in rig files, with how its instruments are found.
struct IdentifiedDriver {
  std::string name;
  Identification identification;
};
/// Those of all roles that can be found by numbers on USB or by a question; each once, in the order
/// of the registry.
std::vector<IdentifiedDriver> identified_drivers();

/// `address` of a role's table, checked; "emulated" when it is not there.
std::string read_address(ConfigReader& reader);

/// Whether the address names images or a video in files, which are no instrument.
bool is_recording(const std::string& address);

/// The address of a USB or HID instrument; `scheme` is "usb" or "hid". Throws ConfigError.
UsbAddress read_usb_address(const InstrumentReader& instrument, const std::string& scheme);

/// Whether the driver of a role's table is no name of the registry but an instrument's Lua file
/// (host/rig/instrument_file.h).
bool names_instrument_file(const ConfigReader& reader);
/// Reads the settings that such a file declares; the kind that it declares must be the role's.
/// Throws ConfigError, with the file's line where that is wrong. Defined for every role.
template <class Role>
Opener<Role> read_scripted(const InstrumentReader& instrument);

/// Where a rig file names none; "" where there is none.
template <class Role>
std::string usual_driver() {
  return drivers<Role>().empty() ? "" : drivers<Role>().front().name;
}

/// Reads `driver`, `address` and what that driver wants, and adds its commands' costs to `links`;
/// `usual` is the driver where the rig file names none. The caller finishes the reader.
template <class Role>
Opener<Role> read_instrument(ConfigReader& reader, const std::string& role,
                             sim::LaboratorySettings& laboratory, LinkLoads& links,
                             const std::string& usual = usual_driver<Role>()) {
  std::vector<std::string> names;
  for (const auto& entry : drivers<Role>()) names.emplace_back(entry.name);
  const std::string named = reader.peek("driver");
  if (std::find(names.begin(), names.end(), named) == names.end() &&
      names_instrument_file(reader)) {
    reader.text("driver", "");
    const InstrumentReader instrument{reader, role, read_address(reader), laboratory, links};
    return explained(instrument, read_scripted<Role>(instrument));
  }
  const std::string wanted = reader.choice("driver", usual, names);
  const InstrumentReader instrument{reader, role, read_address(reader), laboratory, links};
  for (const auto& entry : drivers<Role>())
    if (entry.name == wanted) return explained(instrument, entry.read(instrument));
  reader.fail("driver", "is not known");
}

/// Every role that a rig file can have, sorted.
const std::vector<std::string>& role_names();
/// The roles of a rig that are instruments with an address, recorded images, or a person; sorted.
std::vector<std::string> real_roles(const RigDescription& description);
/// Whether any other role is there: one that acts on, or looks at, a simulated laboratory.
bool simulates_something(const RigDescription& description);
/// Whether there are real roles: such a rig runs at the pace of the wall clock, and nothing of it
/// can be redrawn, broken on purpose or judged by a simulator's truth.
bool has_real_instruments(const RigDescription& description);

}  // namespace vitreo
