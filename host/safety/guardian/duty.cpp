// SPDX-License-Identifier: Apache-2.0
#include "host/safety/guardian/duty.h"

#include "devices/instruments/kepco_bop/rescue.h"
#include "devices/instruments/usb3103/rescue.h"
#include "devices/links/address.h"
#include "devices/time/error.h"

#include <exception>

namespace vitreo::guardian {
namespace {

// Of the Kepco BOP, where the rig file states none.
constexpr int kUsualBaudRate = 9600;

// A setting of the output, rounded towards zero; the host's drivers have checked its range.
int integer(const Output& output, const char* name, int fallback) {
  const auto found = output.settings.find(name);
  return found == output.settings.end() ? fallback : static_cast<int>(found->second);
}

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

// XON/XOFF is what a BOP has enabled from the factory.
std::unique_ptr<ByteLink> open(const std::string& place, const Output& output, Clock& clock) {
  return open_byte_link(
      place, {.baud_rate = integer(output, "baud_rate", kUsualBaudRate), .xon_xoff = true}, clock);
}

}  // namespace

// The place of each unit is noted now, while the host still vouches for it; nothing is opened.
Duty::Duty(const Output& output) : output_(output) {
  if (output.driver == "usb3103") {
    parse_usb_address("hid", output.address);
    const int line = integer(output, "enable_line", 0);
    if (line < 0 || line > 7) throw std::invalid_argument("enable_line: must be 0 to 7");
  } else if (output.driver == "kepco_bop") {
    for (const std::string& place : addresses_of(output))
      places_.push_back({place, terminal_at(place), std::nullopt});
  } else {
    throw std::invalid_argument("the guardian cannot bring a \"" + output.driver + "\" to zero");
  }
}

// Without an enable line in the settings no line of the USB-3103 is touched: it may drive something
// else.
void Duty::bring_to_zero(Clock& clock) {
  if (output_.driver == "kepco_bop") return bring_bops_to_zero(clock);
  std::optional<int> line;
  if (output_.settings.contains("enable_line")) line = integer(output_, "enable_line", 0);
  const auto link = open_hid_link(parse_usb_address("hid", output_.address), clock);
  usb3103::rescue(*link, line, clock);
}

/// A unit that cannot be reached does not keep the others from their zero.
void Duty::bring_bops_to_zero(Clock& clock) {
  std::vector<std::unique_ptr<ByteLink>> links;
  std::exception_ptr failure;
  for (Place& place : places_) {
    // Every unit is recognized anew at each attempt: a cable may have been pulled and plugged in
    // elsewhere since.
    try {
      recognize(place, clock);
      links.push_back(open(place.address, output_, clock));
    } catch (const DeviceError&) {
      failure = std::current_exception();
    }
  }
  // Those that answered are zeroed first; only then the failure of the others is reported, and the
  // caller tries all again, which does no harm to a unit at zero.
  kepco_bop::rescue(links);
  if (failure) std::rethrow_exception(failure);
}

// A serial port's name is trusted only while it leads to the terminal that the host had: after a
// change of adapters it may be another instrument, to which the same bytes are another command.
void Duty::recognize(Place& place, Clock& clock) {
  const std::optional<Terminal> now = terminal_at(place.address);
  if (!now || now == place.own) return;
  const auto stranger = [&] {
    return DeviceError(DeviceErrorKind::not_found, place.address,
                       "by now this name leads to something else");
  };
  // Asked once and no more: an attempt comes every 2 ms, and the stranger must be left alone.
  if (now == place.foreign) throw stranger();
  if (kepco_bop::answers(*open(place.address, output_, clock))) {
    place.own = now;
    return;
  }
  place.foreign = now;
  throw stranger();
}

}  // namespace vitreo::guardian
