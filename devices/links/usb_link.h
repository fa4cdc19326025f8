// USB link: control transfers on endpoint 0 of an instrument, an emulator or a recording.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_address.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// The eight bytes that begin a control transfer, but for the length. Bit 7 of `type` set: device
/// to host.
struct UsbSetup {
  std::uint8_t type = 0;
  std::uint8_t request = 0;
  std::uint16_t value = 0;
  std::uint16_t index = 0;
};

class UsbLink {
 public:
  virtual ~UsbLink() = default;
  virtual const UsbIdentity& identity() const = 0;
  /// Host to device. Throws DeviceError{lost}, {timeout}, {refused} when the device stalls the
  /// transfer; Stopped, but only once the transfer is on its way, so that a stopped task can still
  /// stop its motor.
  virtual void write(const UsbSetup& setup, std::span<const std::uint8_t> data, Time timeout) = 0;
  /// Device to host: up to `length` bytes; fewer when the device has no more. Throws as write()
  /// does.
  virtual std::vector<std::uint8_t> read(const UsbSetup& setup, std::uint16_t length,
                                         Time timeout) = 0;
};

/// Bulk endpoints of an instrument: 1 OUT and 2 IN of an interface of the class USBTMC.
class BulkPeer {
 public:
  virtual ~BulkPeer() = default;
  /// One transfer on Bulk-OUT. False: it halts the endpoint.
  virtual bool take(std::span<const std::uint8_t> transfer) = 0;
  /// The next transfer on Bulk-IN; nothing while it has none.
  virtual std::optional<std::vector<std::uint8_t>> give() = 0;
};

/// The instrument's end of the same wire.
class UsbPeer {
 public:
  virtual ~UsbPeer() = default;
  virtual const UsbIdentity& identity() const = 0;
  /// Answers one transfer; of the answer at most `length` bytes reach the host. Nothing means a
  /// stall: the device does not know the request.
  virtual std::optional<std::vector<std::uint8_t>> control(const UsbSetup& setup,
                                                           std::span<const std::uint8_t> data,
                                                           std::uint16_t length) = 0;
  /// Null: it has endpoint 0 alone.
  virtual BulkPeer* bulk() { return nullptr; }
  /// Switched off and on: what it does not keep is as after power-up.
  virtual void power_cycle() {}
};

/// A link in memory. A transfer is over with the next frame of `interval` (kUsbFrame; zero: at
/// once) that no transfer before it has, for which the caller waits: setup, data and status of a
/// short control transfer share a frame. `peer` must outlive the link. Throws std::invalid_argument
/// for a negative interval.
std::unique_ptr<UsbLink> memory_usb_link(UsbPeer& peer, Clock& clock, Time interval);

/// The device with this address, by libusb. Throws DeviceError{not_found} (none, or several and no
/// serial number to choose by), {refused} without the right to open it.
std::unique_ptr<UsbLink> open_usb_link(const UsbAddress& address, Clock& clock);
/// What is plugged in; strings are empty for a device that may not be opened. Throws
/// DeviceError{lost} without USB.
std::vector<UsbIdentity> list_usb_devices();

}  // namespace vitreo
