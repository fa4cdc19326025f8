// USBTMC link: instruments on USB that take and give messages, such as the THM1176 teslameter; the
// class' framing over the transfers of a bus.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/message_link.h"
#include "devices/links/usb_link.h"

#include <memory>
#include <span>
#include <string>

namespace vitreo {

/// The transfers of one USBTMC interface, by libusb or to a stand-in.
class UsbtmcPipe {
 public:
  virtual ~UsbtmcPipe() = default;
  virtual const std::string& address() const = 0;
  virtual std::uint8_t interface_number() const = 0;
  virtual std::uint8_t out_endpoint() const = 0;  ///< address of Bulk-OUT
  virtual std::uint8_t in_endpoint() const = 0;   ///< address of Bulk-IN
  /// One transfer on Bulk-OUT. Throws DeviceError{timeout}, after which a part of it may have gone,
  /// {refused} for an endpoint that is halted, {lost}.
  virtual void out(std::span<const std::uint8_t> transfer, Time timeout) = 0;
  struct In {
    ByteString bytes;
    bool over = false;  ///< a short packet has ended the transfer
  };
  /// What comes on Bulk-IN within `timeout`, up to the end of a transfer. Throws as out(), but not
  /// {timeout}; Stopped.
  virtual In in(std::size_t most, Time timeout) = 0;
  /// Device to host, on endpoint 0. Throws DeviceError{timeout}, {refused}, {lost}.
  virtual ByteString control(const UsbSetup& setup, std::uint16_t length, Time timeout) = 0;
  /// CLEAR_FEATURE(ENDPOINT_HALT).
  virtual void clear_halt(std::uint8_t endpoint) = 0;
  virtual void reopen() = 0;
};

/// Messages on such a pipe. A read that nothing answered stays asked for, until the next read or
/// write; a write ends it (INITIATE_ABORT_BULK_IN) and drops what had come of a message. Throws
/// std::invalid_argument for no pipe.
std::unique_ptr<MessageLink> usbtmc_link(std::unique_ptr<UsbtmcPipe> pipe, Clock& clock);

/// `place` as behind "usbtmc:": "1bfa:0498", "1bfa:0498:SERIAL", or the kernel's node of it,
/// "/dev/usbtmc0", from which its kernel driver is then taken. Throws std::invalid_argument for a
/// place that is none, DeviceError{not_found}, {refused} without the right to open it or where
/// another program has it.
std::unique_ptr<MessageLink> open_usbtmc(const std::string& place, Clock& clock);

/// Through libusb.
std::unique_ptr<UsbtmcPipe> open_usbtmc_pipe(const std::string& place, Clock& clock);

}  // namespace vitreo
