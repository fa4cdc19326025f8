// SPDX-License-Identifier: Apache-2.0
#include "host/rig/registry.h"

#include "devices/instruments/foot_pedal/identification.h"
#include "devices/instruments/kepco_bop/identification.h"
#include "devices/instruments/led_lamp/identification.h"
#include "devices/instruments/opencv_camera/driver.h"
#include "devices/instruments/pololu_tic/identification.h"
#include "devices/instruments/scpi_logger/identification.h"
#include "devices/instruments/scpi_probe/identification.h"
#include "devices/instruments/spacemouse/identification.h"
#include "devices/instruments/sutter_mp285/identification.h"
#include "devices/instruments/sutter_mpc200/identification.h"
#include "devices/instruments/usb3103/identification.h"
#include "devices/instruments/zaber/identification.h"
#include "devices/links/address.h"
#include "host/rig/drivers/drivers.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo {

template <>
const std::vector<DriverEntry<CoilAmplifier>>& drivers() {
  static const std::vector<DriverEntry<CoilAmplifier>> entries{
      {"usb3103", read_usb3103, usb3103::identification},
      {"kepco_bop", read_kepco_bop, kepco_bop::identification},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<LensMover>>& drivers() {
  static const std::vector<DriverEntry<LensMover>> entries{
      {"pololu_tic", read_pololu_tic, pololu_tic::identification}};
  return entries;
}

template <>
const std::vector<DriverEntry<OperatorInput>>& drivers() {
  static const std::vector<DriverEntry<OperatorInput>> entries{
      {"spacemouse", read_spacemouse, spacemouse::identification},
      {"foot_pedal", read_foot_pedal, foot_pedal::identification},
      {"game_pad", read_game_pad},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<Camera>>& drivers() {
  static const std::vector<DriverEntry<Camera>> entries{
      {"genicam", read_genicam},
      {"image_sequence", read_image_sequence},
      {"iidc", read_iidc},
      {"opencv_camera", read_opencv_camera},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<Stage>>& drivers() {
  static const std::vector<DriverEntry<Stage>> entries{
      {"zaber", read_zaber, zaber::identification},
      {"sutter_mp285", read_sutter_mp285, sutter_mp285::identification},
      {"sutter_mpc200", read_sutter_mpc200, sutter_mpc200::identification},
      {"simulated", read_simulated_stage},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<RotationStage>>& drivers() {
  static const std::vector<DriverEntry<RotationStage>> entries{
      {"zaber", read_zaber_rotary, zaber::identification},
      {"simulated", read_simulated_rotation},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<FieldProbe>>& drivers() {
  static const std::vector<DriverEntry<FieldProbe>> entries{
      {"scpi_probe", read_scpi_probe, scpi_probe::identification},
      {"simulated", read_simulated_probe},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<Lamp>>& drivers() {
  static const std::vector<DriverEntry<Lamp>> entries{
      {"led", read_led_lamp, led_lamp::identification}};
  return entries;
}

template <>
const std::vector<DriverEntry<EnableLine>>& drivers() {
  static const std::vector<DriverEntry<EnableLine>> entries{{"serial_line", read_serial_line}};
  return entries;
}

template <>
const std::vector<DriverEntry<CurrentSensor>>& drivers() {
  static const std::vector<DriverEntry<CurrentSensor>> entries{
      {"scpi_logger", read_scpi_logger, scpi_logger::identification},
      {"simulated", read_simulated_sensor},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<Instrument>>& drivers() {
  static const std::vector<DriverEntry<Instrument>> none;
  return none;
}

namespace {

template <class Role>
void add_identified(std::vector<IdentifiedDriver>& all) {
  for (const auto& entry : drivers<Role>()) {
    const bool known = std::any_of(all.begin(), all.end(), [&](const IdentifiedDriver& driver) {
      return driver.name == entry.name;
    });
    if (entry.identification != nullptr && !known)
      all.push_back({entry.name, entry.identification()});
  }
}

}  // namespace

std::vector<IdentifiedDriver> identified_drivers() {
  std::vector<IdentifiedDriver> all;
  add_identified<CoilAmplifier>(all);
  add_identified<Lamp>(all);
  add_identified<LensMover>(all);
  add_identified<OperatorInput>(all);
  add_identified<Camera>(all);
  add_identified<Stage>(all);
  add_identified<RotationStage>(all);
  // Before the probe, for which any instrument that speaks SCPI is taken.
  add_identified<CurrentSensor>(all);
  add_identified<FieldProbe>(all);
  return all;
}

// The syntax alone is checked: whether something is there is seen when it is opened.
std::string read_address(ConfigReader& reader) {
  // Without an address nothing leaves the program: a rig file that forgets one is harmless.
  std::string address = reader.text("address", "emulated");
  try {
    parse_address(address);
  } catch (const std::invalid_argument& problem) {
    reader.fail("address", problem.what());
  }
  return address;
}

bool is_recording(const std::string& address) {
  const std::string video = "video:";
  return address.starts_with("images:") ||
         (address.starts_with(video) && !opencv_camera::is_node(address.substr(video.size())));
}

UsbAddress read_usb_address(const InstrumentReader& instrument, const std::string& scheme) {
  try {
    return parse_usb_address(scheme, instrument.address);
  } catch (const std::invalid_argument& problem) {
    instrument.reader.fail("address", problem.what());
  }
}

namespace {

/// A person is as real as an instrument with an address. Unlike for is_laboratory(), recorded
/// images count: with them not everything is simulated.
bool is_simulated(const ConfigTable& role) {
  const std::string address = text_of(role, "address");
  return (address.empty() || address == "emulated") && text_of(role, "driver") != "operator";
}

std::vector<std::string> roles_that_are(bool simulated, const RigDescription& description) {
  std::vector<std::string> roles;
  const std::vector<std::string>& fixed = role_names();
  for (const auto& [name, value] : description.table) {
    const auto* const table = std::get_if<ConfigTable>(&value.value);
    if (table == nullptr) continue;
    const bool role = std::find(fixed.begin(), fixed.end(), name) != fixed.end() ||
                      !text_of(*table, "driver").empty();
    if (role && is_simulated(*table) == simulated) roles.push_back(name);
  }
  return roles;
}

}  // namespace

const std::vector<std::string>& role_names() {
  static const std::vector<std::string> names{
      "coils",  "current_sensor", "enable_line", "field_probe", "joystick",
      "lamp",   "lens_mover",     "pedal",       "pose_sensor", "rotation_stage",
      "sample", "side_camera",    "stage",       "top_camera"};
  return names;
}

std::vector<std::string> real_roles(const RigDescription& description) {
  return roles_that_are(false, description);
}

bool simulates_something(const RigDescription& description) {
  return !roles_that_are(true, description).empty();
}

bool has_real_instruments(const RigDescription& description) {
  return !real_roles(description).empty();
}

}  // namespace vitreo
