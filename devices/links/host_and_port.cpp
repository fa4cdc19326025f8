// SPDX-License-Identifier: Apache-2.0
#include "devices/links/host_and_port.h"

#include "devices/time/error.h"

#include <stdexcept>

namespace vitreo {

HostAndPort split_host_and_port(const std::string& bus, const std::string& text) {
  const std::size_t colon = text.rfind(':');
  HostAndPort result;
  if (colon != std::string::npos) result = {text.substr(0, colon), text.substr(colon + 1)};
  if (result.host.size() > 2 && result.host.front() == '[' && result.host.back() == ']')
    result.host = result.host.substr(1, result.host.size() - 2);
  else if (result.host.find(':') != std::string::npos)
    result.host.clear();
  const bool number = !result.port.empty() && result.port.size() <= 5 &&
                      result.port.find_first_not_of("0123456789") == std::string::npos;
  if (result.host.empty() || !number || std::stoi(result.port) < 1 ||
      std::stoi(result.port) > 65535)
    throw std::invalid_argument("address: " + bus + ":" + text + " is not " + bus + ":HOST:PORT");
  return result;
}

std::string join_host_and_port(const std::string& host, int port) {
  const bool sixth = host.find(':') != std::string::npos;
  return (sixth ? "[" + host + "]" : host) + ":" + std::to_string(port);
}

InstrumentPlace parse_instrument_place(const std::string& bus, const std::string& place,
                                       const std::string& device) {
  const auto wrong = [&] {
    return std::invalid_argument("address: " + bus + ":" + place + " is not " + bus +
                                 ":HOST, with :DEVICE and @PORT where they are not the usual ones");
  };
  InstrumentPlace result{place, device, 0};
  const bool bracket = place.starts_with("[");
  const std::size_t end = bracket ? place.find(']') : place.find(':');
  if (bracket && end == std::string::npos) throw wrong();
  const std::size_t colon = bracket ? end + 1 : end;
  result.host = bracket ? place.substr(1, end - 1) : place.substr(0, colon);
  if (colon < place.size()) {
    if (place[colon] != ':') throw wrong();
    result.device = place.substr(colon + 1);
    if (const std::size_t at = result.device.find('@'); at != std::string::npos) {
      const std::string port = result.device.substr(at);
      result.device.resize(at);
      result.port = std::stoi(split_host_and_port(bus, "host:" + port.substr(1)).port);
    }
  }
  if (result.host.empty() || result.device.empty()) throw wrong();
  return result;
}

Resolved resolve(const std::string& address, const HostAndPort& to, int socket_type) {
  addrinfo wanted{};
  addrinfo* found = nullptr;
  wanted.ai_socktype = socket_type;
  const int error = ::getaddrinfo(to.host.c_str(), to.port.c_str(), &wanted, &found);
  if (error != 0) throw DeviceError(DeviceErrorKind::not_found, address, ::gai_strerror(error));
  return {found, &::freeaddrinfo};
}

}  // namespace vitreo
