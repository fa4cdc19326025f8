// UDP link: instruments that talk in datagrams.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/message_link.h"

#include <memory>
#include <string>

namespace vitreo {

/// `host_and_port` as in "udp:192.168.1.7:2000" or "udp:[::1]:2000". A datagram is a message; those
/// of other senders are not taken. Opening sends nothing, so it does not tell whether anything is
/// there: a host that refuses a datagram is {lost} at the next call. Datagrams may be lost or come
/// late without an error: clear() before a question drops what has come. Throws
/// std::invalid_argument for an address that is none, DeviceError{not_found} for a name that the
/// resolver does not know and for a network that cannot be reached.
std::unique_ptr<MessageLink> open_udp(const std::string& host_and_port, Clock& clock);

}  // namespace vitreo
