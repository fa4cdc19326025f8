// SPDX-License-Identifier: Apache-2.0
#include "host/rig/registry.h"

#include "devices/instruments/opencv_camera/driver.h"
#include "devices/links/address.h"
#include "host/rig/drivers/drivers.h"

#include <stdexcept>

namespace vitreo {

template <>
const std::vector<DriverEntry<CoilAmplifier>>& drivers() {
  static const std::vector<DriverEntry<CoilAmplifier>> entries{
      {"usb3103", read_usb3103},
      {"kepco_bop", read_kepco_bop},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<LensMover>>& drivers() {
  static const std::vector<DriverEntry<LensMover>> entries{{"pololu_tic", read_pololu_tic}};
  return entries;
}

template <>
const std::vector<DriverEntry<OperatorInput>>& drivers() {
  static const std::vector<DriverEntry<OperatorInput>> entries{
      {"spacemouse", read_spacemouse},
      {"foot_pedal", read_foot_pedal},
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
      {"zaber", read_zaber},
      {"sutter_mp285", read_sutter_mp285},
      {"sutter_mpc200", read_sutter_mpc200},
      {"simulated", read_simulated_stage},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<RotationStage>>& drivers() {
  static const std::vector<DriverEntry<RotationStage>> entries{
      {"zaber", read_zaber_rotary},
      {"simulated", read_simulated_rotation},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<FieldProbe>>& drivers() {
  static const std::vector<DriverEntry<FieldProbe>> entries{
      {"scpi_probe", read_scpi_probe},
      {"simulated", read_simulated_probe},
  };
  return entries;
}

template <>
const std::vector<DriverEntry<Lamp>>& drivers() {
  static const std::vector<DriverEntry<Lamp>> entries{{"led", read_led_lamp}};
  return entries;
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

// Unlike is_laboratory(), recorded images count: with them not everything is simulated.
bool has_real_instruments(const RigDescription& description) {
  for (const auto& [role, value] : description.table) {
    const auto* const table = std::get_if<ConfigTable>(&value.value);
    if (table == nullptr || !table->contains("address")) continue;
    const auto* const address = std::get_if<std::string>(&table->at("address").value);
    if (address != nullptr && *address != "emulated") return true;
  }
  return false;
}

}  // namespace vitreo
