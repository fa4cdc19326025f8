// Byte link over a message link: each write is one message, and an answer is read only when one is
// due, as instruments on USBTMC, VXI-11 and HiSLIP want it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/message_link.h"

#include <memory>
#include <string>

namespace vitreo {

/// Messages that do not end with `end` get it. An answer is due from a write until one has come; a
/// read that waits at that time asks for it, one that does not wait takes what is there already.
/// Throws std::invalid_argument for no link.
std::unique_ptr<ByteLink> message_bytes(std::unique_ptr<MessageLink> link, const std::string& end,
                                        Clock& clock);

}  // namespace vitreo
