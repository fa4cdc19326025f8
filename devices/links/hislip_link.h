// HiSLIP link: instruments on a network by IVI-6.1, version 1: two connections, messages with
// numbers, device clear.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/host_and_port.h"
#include "devices/links/message_link.h"

#include <functional>
#include <memory>
#include <string>

namespace vitreo {

/// `place` as behind "hislip:", the sub-address hislip0 where it says none, port 4880. Takes the
/// exclusive lock where the instrument has locks: {refused} where another client has it. An answer
/// to a question of before is dropped by its number; a write drops what has come of an answer that
/// is not whole. Throws std::invalid_argument for a place that is none, DeviceError{not_found} for
/// a sub-address that the instrument does not have, and as open_tcp() does.
std::unique_ptr<MessageLink> open_hislip(const std::string& place, Clock& clock);

/// The same on other connections, such as those to an emulator; `connect` is called twice, for the
/// synchronous channel first.
std::unique_ptr<MessageLink> open_hislip_on(const std::string& address,
                                            const InstrumentPlace& place,
                                            std::function<std::unique_ptr<ByteLink>()> connect,
                                            Clock& clock);

}  // namespace vitreo
