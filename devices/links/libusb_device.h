// Devices on USB through libusb: sessions, errors, the search for one device.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/node_lock.h"
#include "devices/links/usb_address.h"
#include "devices/time/clock.h"
#include "devices/time/error.h"

#include <functional>
#include <libusb.h>
#include <memory>
#include <string>
#include <utility>

namespace vitreo {

using UsbContext = std::unique_ptr<libusb_context, decltype(&libusb_exit)>;
using UsbHandle = std::unique_ptr<libusb_device_handle, decltype(&libusb_close)>;

/// libusb's errors by what a caller can do about them: a stall (PIPE) is the device's refusal of a
/// request, a lack of rights or a second owner the system's.
DeviceError usb_error(int code, const std::string& device, const std::string& what);

/// A session of libusb; fails where the kernel offers no USB at all, as in some containers.
UsbContext new_usb_context();

/// Calls `visit` for each device on the bus.
void for_each_usb_device(
    libusb_context* context,
    const std::function<void(libusb_device*, const libusb_device_descriptor&)>& visit);

/// Strings need an open handle; null: they stay empty. The place is bus and address, which change
/// with each plugging in.
UsbIdentity identify_usb(libusb_device* device, const libusb_device_descriptor& descriptor,
                         libusb_device_handle* handle);

/// A device of one's own: opened, its node locked. Its session has no other device.
struct OwnUsbDevice {
  OwnUsbDevice() = default;
  OwnUsbDevice(OwnUsbDevice&&) = default;
  /// The device is closed before its session.
  OwnUsbDevice& operator=(OwnUsbDevice&& other) noexcept {
    handle = std::move(other.handle);
    context = std::move(other.context);
    identity = std::move(other.identity);
    lock = std::move(other.lock);
    return *this;
  }
  UsbContext context{nullptr, libusb_exit};
  UsbHandle handle{nullptr, libusb_close};
  UsbIdentity identity{};
  NodeLock lock{};
};
/// The one that `wanted` takes, of those with the numbers; `name` is for errors. Throws
/// DeviceError{not_found} (none, or several), {refused}.
OwnUsbDevice open_own_usb_device(std::uint16_t vendor, std::uint16_t product,
                                 const std::function<bool(const UsbIdentity&)>& wanted,
                                 const std::string& name);

/// ms as libusb wants them, rounded up: a deadline that is a fraction of one away has not passed,
/// and 0 would be none at all.
unsigned usb_milliseconds(Time timeout);

}  // namespace vitreo
