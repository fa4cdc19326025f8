// Host and port of an address on a network, and the resolver's answer for it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <netdb.h>
#include <string>

namespace vitreo {

struct HostAndPort {
  std::string host;
  std::string port;
};

/// "host:port"; an IPv6 address, which has colons itself, stands in brackets (RFC 3986). `bus` is
/// for the error: "tcp". Throws std::invalid_argument.
HostAndPort split_host_and_port(const std::string& bus, const std::string& text);

/// "192.168.1.7:5025", "[::1]:5025".
std::string join_host_and_port(const std::string& host, int port);

/// What stands behind "vxi11:" and "hislip:": "192.168.1.7", "192.168.1.7:inst0",
/// "192.168.1.7:gpib0,5", "[::1]:hislip0"; with another port than is usual, "127.0.0.1:inst0@1024".
struct InstrumentPlace {
  std::string host;
  std::string device;
  int port = 0;  ///< 0: the usual one
};
/// `device`: where the place says none. Throws std::invalid_argument.
InstrumentPlace parse_instrument_place(const std::string& bus, const std::string& place,
                                       const std::string& device);

using Resolved = std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)>;
/// `socket_type`: SOCK_STREAM, SOCK_DGRAM. A name takes as long as the system's resolver, a number
/// no time. Throws DeviceError{not_found} under `address`.
Resolved resolve(const std::string& address, const HostAndPort& to, int socket_type);

}  // namespace vitreo
