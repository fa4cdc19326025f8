// TCP link: instruments with a network socket, and serial ports behind a terminal server.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <memory>
#include <string>

namespace vitreo {

/// `host_and_port` as in "tcp:192.168.1.7:5025" or "tcp:[::1]:5025". Throws std::invalid_argument
/// for one that is neither, DeviceError{not_found} when the connection is refused, {timeout} when
/// there is no answer within `timeout`. A name in a number's place is looked up first, for as long
/// as the system's resolver takes.
std::unique_ptr<ByteLink> open_tcp(const std::string& host_and_port, Time timeout, Clock& clock);

}  // namespace vitreo
