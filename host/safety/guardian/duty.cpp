// SPDX-License-Identifier: Apache-2.0
#include "host/safety/guardian/duty.h"

#include "devices/instruments/byte_script.h"
#include "devices/instruments/rescues.h"
#include "devices/links/address.h"
#include "devices/time/error.h"

#include <exception>
#include <stdexcept>
#include <variant>

namespace vitreo::guardian {
namespace {

/// The units' addresses, which stand between commas.
std::vector<std::string> addresses_of(const Output& output) {
  std::vector<std::string> all;
  std::istringstream addresses(output.address);
  for (std::string one; std::getline(addresses, one, ',');) {
    const std::size_t begin = one.find_first_not_of(' ');
    all.push_back(begin == std::string::npos ? "" : one.substr(begin));
  }
  return all;
}

/// None on another bus than the serial one, and where there is no such terminal.
/// The time of the last change tells apart terminals that were given the same numbers one after the
/// other, as pseudo-terminals are.
std::optional<Terminal> terminal_at(const std::string& place) {
  const Address address = parse_address(place);
  struct stat found {};
  if (address.bus != "serial" || stat(address.place.c_str(), &found) != 0) return std::nullopt;
  return Terminal{found.st_dev, found.st_ino, found.st_ctim};
}

Rescue rescue_of(const Output& output) {
  if (!output.script.empty()) return rescue_by(parse_byte_script(output.script));
  const Rescue* const found = find_rescue(output.driver);
  if (found == nullptr)
    throw std::invalid_argument("the guardian cannot bring a \"" + output.driver + "\" to zero");
  return *found;
}

/// The line as the rig file has it; choices come as their places among their names.
SerialSettings line_of(const RescueSettings& settings, SerialSettings line) {
  const auto set = [&settings](const char* key, const auto& take) {
    if (const auto found = settings.find(key); found != settings.end())
      take(static_cast<int>(found->second));
  };
  set("baud_rate", [&](int value) { line.baud_rate = value; });
  set("data_bits", [&](int value) { line.data_bits = value; });
  set("stop_bits", [&](int value) { line.stop_bits = value; });
  set("parity", [&](int value) { line.parity = static_cast<Parity>(value); });
  set("flow", [&](int value) { set_flow(line, flow_names().at(static_cast<std::size_t>(value))); });
  return line;
}

}  // namespace

// The place of each unit is noted now, while the host still vouches for it; nothing is opened.
Duty::Duty(const Output& output) : output_(output), rescue_(rescue_of(output)) {
  if (rescue_.check != nullptr) rescue_.check(output.settings);
  if (std::holds_alternative<HidRescue>(rescue_.way))
    parse_usb_address("hid", output.address);
  else
    for (const std::string& place : addresses_of(output))
      places_.push_back({place, terminal_at(place), std::nullopt});
}

void Duty::bring_to_zero(Clock& clock) {
  std::visit([&](const auto& way) { bring_to_zero(way, clock); }, rescue_.way);
}

void Duty::bring_to_zero(const HidRescue& rescue, Clock& clock) {
  const auto link = open_hid_link(parse_usb_address("hid", output_.address), clock);
  rescue.zero(*link, output_.settings, clock);
}

std::unique_ptr<ByteLink> Duty::open(const std::string& place, const ByteRescue& rescue,
                                     Clock& clock) const {
  return open_byte_link(place, line_of(output_.settings, rescue.line), clock);
}

/// A unit that cannot be reached does not keep the others from their zero.
void Duty::bring_to_zero(const ByteRescue& rescue, Clock& clock) {
  std::vector<std::unique_ptr<ByteLink>> links;
  std::exception_ptr failure;
  for (Place& place : places_) {
    // Every unit is recognized anew at each attempt: a cable may have been pulled and plugged in
    // elsewhere since.
    try {
      recognize(place, rescue, clock);
      links.push_back(open(place.address, rescue, clock));
    } catch (const DeviceError&) {
      failure = std::current_exception();
    }
  }
  // Those that answered are zeroed first; only then the failure of the others is reported, and the
  // caller tries all again, which does no harm to a unit at zero.
  rescue.zero(links);
  if (failure) std::rethrow_exception(failure);
}

// A serial port's name is trusted only while it leads to the terminal that the host had: after a
// change of adapters it may be another instrument, to which the same bytes are another command.
void Duty::recognize(Place& place, const ByteRescue& rescue, Clock& clock) {
  const std::optional<Terminal> now = terminal_at(place.address);
  if (!now || now == place.own) return;
  const auto stranger = [&] {
    return DeviceError(DeviceErrorKind::not_found, place.address,
                       "by now this name leads to something else");
  };
  // Asked once and no more: an attempt comes every 2 ms, and the stranger must be left alone.
  if (now == place.foreign) throw stranger();
  if (rescue.answers(*open(place.address, rescue, clock))) {
    place.own = now;
    return;
  }
  place.foreign = now;
  throw stranger();
}

}  // namespace vitreo::guardian
