// SPDX-License-Identifier: Apache-2.0
#include "devices/links/libusb_device.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <limits>
#include <utility>

namespace vitreo {
namespace {

/// A string descriptor; empty where there is none or it cannot be read.
std::string string_descriptor(libusb_device_handle* handle, std::uint8_t index) {
  std::array<unsigned char, 256> bytes{};
  if (handle == nullptr || index == 0) return "";
  const int size = libusb_get_string_descriptor_ascii(handle, index, bytes.data(),
                                                      static_cast<int>(bytes.size()));
  return size < 0 ? "" : std::string(bytes.begin(), bytes.begin() + size);
}

std::string usb_node_of(libusb_device* device) {
  std::array<char, 32> path{};
  std::snprintf(path.data(), path.size(), "/dev/bus/usb/%03d/%03d", libusb_get_bus_number(device),
                libusb_get_device_address(device));
  return path.data();
}

DeviceErrorKind kind_of_usb_error(int code) {
  switch (code) {
    case LIBUSB_ERROR_TIMEOUT:
      return DeviceErrorKind::timeout;
    case LIBUSB_ERROR_PIPE:
    case LIBUSB_ERROR_ACCESS:
    case LIBUSB_ERROR_BUSY:
    case LIBUSB_ERROR_NOT_SUPPORTED:
    case LIBUSB_ERROR_INVALID_PARAM:
      return DeviceErrorKind::refused;
    case LIBUSB_ERROR_OVERFLOW:
      return DeviceErrorKind::protocol;
    default:  // NO_DEVICE, IO and the other errors of a device that is being unplugged
      return DeviceErrorKind::lost;
  }
}

}  // namespace

DeviceError usb_error(int code, const std::string& device, const std::string& what) {
  return {kind_of_usb_error(code), device,
          what + ": " + libusb_strerror(static_cast<libusb_error>(code))};
}

UsbContext new_usb_context() {
  libusb_context* context = nullptr;
  if (const int code = libusb_init(&context); code != 0)
    throw usb_error(code, "usb", "no USB on this machine");
  return {context, libusb_exit};
}

void for_each_usb_device(
    libusb_context* context,
    const std::function<void(libusb_device*, const libusb_device_descriptor&)>& visit) {
  libusb_device** devices = nullptr;
  const auto count = libusb_get_device_list(context, &devices);
  if (count < 0) throw usb_error(static_cast<int>(count), "usb", "the bus cannot be listed");
  const std::unique_ptr<libusb_device*, void (*)(libusb_device**)> list(
      devices, [](libusb_device** all) { libusb_free_device_list(all, 1); });
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    libusb_device_descriptor descriptor{};
    if (libusb_get_device_descriptor(devices[i], &descriptor) == 0) visit(devices[i], descriptor);
  }
}

UsbIdentity identify_usb(libusb_device* device, const libusb_device_descriptor& d,
                         libusb_device_handle* handle) {
  return {d.idVendor,
          d.idProduct,
          d.bcdDevice,
          string_descriptor(handle, d.iSerialNumber),
          string_descriptor(handle, d.iManufacturer),
          string_descriptor(handle, d.iProduct),
          "bus " + std::to_string(libusb_get_bus_number(device)) + " device " +
              std::to_string(libusb_get_device_address(device))};
}

// Opens every candidate: serial numbers can be read of open devices only. A device that may not be
// opened could be the wanted one, so its refusal is reported where no other fits.
OwnUsbDevice open_own_usb_device(std::uint16_t vendor, std::uint16_t product,
                                 const std::function<bool(const UsbIdentity&)>& wanted,
                                 const std::string& name) {
  OwnUsbDevice own;
  own.context = new_usb_context();
  int found = 0;
  int refusal = 0;
  std::string node;
  for_each_usb_device(own.context.get(),
                      [&](libusb_device* device, const libusb_device_descriptor& descriptor) {
                        if (descriptor.idVendor != vendor || descriptor.idProduct != product)
                          return;
                        libusb_device_handle* opened = nullptr;
                        if (const int code = libusb_open(device, &opened); code != 0) {
                          refusal = code;
                          return;
                        }
                        UsbHandle handle(opened, libusb_close);
                        const UsbIdentity identity = identify_usb(device, descriptor, opened);
                        if (!wanted(identity)) return;
                        ++found;
                        own.identity = identity;
                        node = usb_node_of(device);
                        own.handle = std::move(handle);
                      });
  if (found == 1) {
    own.lock = NodeLock(node, name);
    return own;
  }
  if (found > 1)
    throw DeviceError(DeviceErrorKind::not_found, name,
                      "there are several; say which by :SERIAL in the address");
  if (refusal != 0) throw usb_error(refusal, name, "it is there, but may not be opened");
  throw DeviceError(DeviceErrorKind::not_found, name, "no such device is plugged in");
}

unsigned usb_milliseconds(Time timeout) {
  return static_cast<unsigned>(
      std::clamp<std::int64_t>(std::chrono::ceil<std::chrono::milliseconds>(timeout).count(), 1,
                               std::numeric_limits<int>::max()));
}

}  // namespace vitreo
