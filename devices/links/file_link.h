// Byte link over a file descriptor: what serial ports, pseudo-terminals and sockets have in common.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/clock.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

namespace vitreo {

/// An open descriptor that does not block, and is closed by the destructor.
class OpenFile {
 public:
  virtual ~OpenFile() = default;
  virtual int handle() const = 0;
};
/// One that ::close closes.
std::unique_ptr<OpenFile> own_descriptor(int handle);

/// Opens with `open`, which throws DeviceError, here and at each reopen(). It waits on the clock in
/// short slices: the clock must go at the pace of the wall clock. `settings` follows the address in
/// its description, " at 9600 baud, 8N1"; empty where a line has none.
std::unique_ptr<ByteLink> file_link(std::string address, std::string settings,
                                    std::function<std::unique_ptr<OpenFile>()> open, Clock& clock);

/// As ::write, but a socket whose far end is gone gives EPIPE and no signal.
std::ptrdiff_t write_quietly(int handle, std::span<const std::uint8_t> bytes);

/// The text of the last failed system call.
std::string system_error();

}  // namespace vitreo
