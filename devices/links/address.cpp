// SPDX-License-Identifier: Apache-2.0
#include "devices/links/address.h"

#include "devices/links/tcp_link.h"

#include <stdexcept>

namespace vitreo {
namespace {

/// A host that is there answers within milliseconds; a host that is not there is silent for
/// minutes.
constexpr Time kConnectTimeout = std::chrono::seconds(2);

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

}  // namespace vitreo
