// SPDX-License-Identifier: Apache-2.0
#include "devices/links/address.h"

#include "devices/links/hislip_link.h"
#include "devices/links/tcp_link.h"
#include "devices/links/udp_link.h"
#include "devices/links/usbtmc_link.h"
#include "devices/links/vxi11_link.h"

#include <algorithm>
#include <stdexcept>
#include <vector>

namespace vitreo {
namespace {

/// A host that is there answers within milliseconds; a host that is not there is silent for
/// minutes.
constexpr Time kConnectTimeout = std::chrono::seconds(2);

/// A bus that carries whole messages.
struct MessageBus {
  const char* name;
  const char* form;  ///< for errors
  std::unique_ptr<MessageLink> (*open)(const std::string& place, Clock& clock);
};
const std::vector<MessageBus> kMessageBuses{
    {"udp", "udp:HOST:PORT", open_udp},
    {"usbtmc", "usbtmc:VVVV:PPPP[:SERIAL]", open_usbtmc},
    {"vxi11", "vxi11:HOST[:DEVICE]", open_vxi11},
    {"hislip", "hislip:HOST[:SUBADDRESS]", open_hislip},
};

}  // namespace

Address parse_address(const std::string& text) {
  if (text == "emulated") return {text, ""};
  // At the first colon: paths and ports may hold more of them.
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos || colon == 0 || colon + 1 == text.size())
    throw std::invalid_argument("address: \"" + text +
                                "\" is not BUS:PLACE, such as serial:/dev/ttyUSB0");
  return {text.substr(0, colon), text.substr(colon + 1)};
}

// The buses that carry a stream of bytes; "emulated" has been handled by the caller, who has the
// emulator.
std::unique_ptr<ByteLink> open_byte_link(const std::string& address, const SerialSettings& serial,
                                         Clock& clock) {
  const Address where = parse_address(address);
  if (where.bus == "serial") return open_serial(where.place, serial, clock);
  if (where.bus == "tcp") return open_tcp(where.place, kConnectTimeout, clock);
  throw std::invalid_argument("address: \"" + address +
                              "\" is neither serial:PATH nor tcp:HOST:PORT");
}

std::unique_ptr<EventLink> open_event_link(const std::string& address, Clock& clock) {
  const Address where = parse_address(address);
  if (where.bus == "evdev") return open_evdev(where.place, clock);
  throw std::invalid_argument("address: \"" + address +
                              "\" is not evdev:/dev/input/eventN or evdev:VVVV:PPPP");
}

bool carries_messages(const std::string& address) {
  const std::string bus = parse_address(address).bus;
  return std::any_of(kMessageBuses.begin(), kMessageBuses.end(),
                     [&](const MessageBus& one) { return bus == one.name; });
}

std::unique_ptr<MessageLink> open_message_link(const std::string& address, Clock& clock) {
  const Address where = parse_address(address);
  for (const MessageBus& bus : kMessageBuses)
    if (where.bus == bus.name) return bus.open(where.place, clock);
  std::string known;
  for (const MessageBus& bus : kMessageBuses)
    known += std::string(known.empty() ? "" : ", ") + bus.form;
  throw std::invalid_argument("address: \"" + address + "\" is none of " + known);
}

}  // namespace vitreo
