// SPDX-License-Identifier: Apache-2.0
#include "host/rig/opening_error.h"

#include <algorithm>

namespace vitreo {
namespace {

/// "serial:", "tcp:"; empty for "emulated".
std::string bus_of(const std::string& address) {
  const std::size_t colon = address.find(':');
  return colon == std::string::npos ? "" : address.substr(0, colon + 1);
}

/// The first address of several, and how many more there are.
std::string in_short(const std::string& address) {
  const auto more = std::count(address.begin(), address.end(), ',');
  return address.substr(0, address.find(',')) +
         (more > 0 ? " and " + std::to_string(more) + " more" : "");
}

/// "rotation_stage (zaber) is on serial:/dev/ttyUSB1": the roles whose cables could be mistaken for
/// that of `role`.
std::string neighbors(const std::string& role, const std::string& bus, const nlohmann::json& rig) {
  std::string text;
  for (const auto& [other, settings] : rig.items()) {
    if (other == role || !settings.is_object() || !settings.contains("driver")) continue;
    const std::string address = settings.value("address", "");
    if (bus_of(address) != bus) continue;
    text += (text.empty() ? "" : ", ") + other + " (" + settings["driver"].get<std::string>() +
            ") is on " + in_short(address);
  }
  return text;
}

/// Whether the line itself opened, and what is at its end was not what it should be.
bool is_of_the_far_end(const DeviceError& error, const std::string& role) {
  return error.device == role &&
         (error.kind == DeviceErrorKind::timeout || error.kind == DeviceErrorKind::protocol ||
          error.kind == DeviceErrorKind::not_found);
}

}  // namespace

DeviceError opening_error(const DeviceError& error, const std::string& role,
                          const std::string& address, const nlohmann::json* rig) {
  std::string text = renamed(error, role).text;
  const std::string bus = bus_of(address);
  if ((bus == "hid:" || bus == "usb:") && text.find(address) == std::string::npos)
    text += "; its address is " + address;
  // The driver, where it came to speak, says itself what became of its zero.
  if (role == "coils" && error.device != role)
    text += "; no zero was sent, so a current that was set before may still flow";
  if (rig != nullptr && (bus == "serial:" || bus == "tcp:") && is_of_the_far_end(error, role))
    if (const std::string others = neighbors(role, bus, *rig); !others.empty())
      text += (text.ends_with('?') ? " " : "; ") + others;
  return {error.kind, role, text};
}

}  // namespace vitreo
