// USB devices by libusb. The only file that includes libusb.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/node_lock.h"
#include "devices/links/usb_link.h"
#include "devices/time/error.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <libusb.h>
#include <limits>
#include <utility>

namespace vitreo {
namespace {

using Context = std::unique_ptr<libusb_context, decltype(&libusb_exit)>;
using Handle = std::unique_ptr<libusb_device_handle, decltype(&libusb_close)>;

/// libusb's errors by what a caller can do about them: a stall (PIPE) is the device's refusal of a
/// request, a lack of rights or a second owner the system's.
DeviceError usb_error(int code, const std::string& device, const std::string& what) {
  const auto kind = [code] {
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
  }();
  return {kind, device, what + ": " + libusb_strerror(static_cast<libusb_error>(code))};
}

/// A session of libusb; fails where the kernel offers no USB at all, as in some containers.
Context new_context() {
  libusb_context* context = nullptr;
  if (const int code = libusb_init(&context); code != 0)
    throw usb_error(code, "usb", "no USB on this machine");
  return {context, libusb_exit};
}

/// A string descriptor; empty where there is none or it cannot be read.
std::string text(libusb_device_handle* handle, std::uint8_t index) {
  std::array<unsigned char, 256> bytes{};
  if (handle == nullptr || index == 0) return "";
  const int size = libusb_get_string_descriptor_ascii(handle, index, bytes.data(),
                                                      static_cast<int>(bytes.size()));
  return size < 0 ? "" : std::string(bytes.begin(), bytes.begin() + size);
}

/// Calls `visit(device, descriptor)` for each device on the bus.
template <class Visit>
void for_each_device(libusb_context* context, Visit visit) {
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

/// Strings need an open handle; null: they stay empty.
/// The place is bus and address, which change with each plugging in.
UsbIdentity identify(libusb_device* device, const libusb_device_descriptor& d,
                     libusb_device_handle* handle) {
  return {d.idVendor,
          d.idProduct,
          d.bcdDevice,
          text(handle, d.iSerialNumber),
          text(handle, d.iManufacturer),
          text(handle, d.iProduct),
          "bus " + std::to_string(libusb_get_bus_number(device)) + " device " +
              std::to_string(libusb_get_device_address(device))};
}

std::string node_of(libusb_device* device) {
  std::array<char, 32> path{};
  std::snprintf(path.data(), path.size(), "/dev/bus/usb/%03d/%03d", libusb_get_bus_number(device),
                libusb_get_device_address(device));
  return path.data();
}

/// Transfers block, so they run outside the clock's baton. A context of its own each: no state is
/// shared between links.
class LibusbLink final : public UsbLink {
 public:
  LibusbLink(const UsbAddress& address, Clock& clock)
      : clock_(clock),
        name_(to_string("usb", address)),
        context_(nullptr, libusb_exit),
        handle_(nullptr, libusb_close) {
    clock_.outside([&] {
      context_ = new_context();
      find(address);
    });
  }
  const UsbIdentity& identity() const override { return identity_; }

  /// libusb takes a buffer that is not const, for both directions are one function.
  void write(const UsbSetup& setup, std::span<const std::uint8_t> data, Time timeout) override {
    std::vector<std::uint8_t> copy(data.begin(), data.end());
    if (transfer(setup, copy, timeout) != static_cast<int>(copy.size()))
      throw DeviceError(DeviceErrorKind::protocol, name_,
                        "the device took only a part of the data");
  }
  std::vector<std::uint8_t> read(const UsbSetup& setup, std::uint16_t length,
                                 Time timeout) override {
    std::vector<std::uint8_t> bytes(length);
    bytes.resize(static_cast<std::size_t>(transfer(setup, bytes, timeout)));
    return bytes;
  }

 private:
  /// Opens every candidate: serial numbers can be read of open devices only.
  /// A device that may not be opened could be the wanted one, so its refusal is reported where no
  /// other fits.
  void find(const UsbAddress& address) {
    int found = 0;
    int refusal = 0;
    for_each_device(
        context_.get(), [&](libusb_device* device, const libusb_device_descriptor& descriptor) {
          if (descriptor.idVendor != address.vendor || descriptor.idProduct != address.product)
            return;
          libusb_device_handle* opened = nullptr;
          if (const int code = libusb_open(device, &opened); code != 0) {
            refusal = code;
            return;
          }
          Handle handle(opened, libusb_close);
          const UsbIdentity identity = identify(device, descriptor, opened);
          if (!identity.matches(address)) return;
          ++found;
          identity_ = identity;
          place_ = node_of(device);
          handle_ = std::move(handle);
        });
    if (found == 1) {
      lock_ = NodeLock(place_, name_);
      return;
    }
    if (found > 1)
      throw DeviceError(DeviceErrorKind::not_found, name_,
                        "there are several; say which by :SERIAL in the address");
    if (refusal != 0) throw usb_error(refusal, name_, "it is there, but may not be opened");
    throw DeviceError(DeviceErrorKind::not_found, name_, "no such device is plugged in");
  }

  int transfer(const UsbSetup& setup, std::vector<std::uint8_t>& data, Time timeout) {
    // Rounded up, as for hidapi: a deadline that is a fraction of a millisecond away has not
    // passed. libusb takes 0 for no deadline at all.
    const auto milliseconds =
        std::clamp<std::int64_t>(std::chrono::ceil<std::chrono::milliseconds>(timeout).count(), 1,
                                 std::numeric_limits<int>::max());
    int code = 0;
    clock_.outside([&] {
      code = libusb_control_transfer(
          handle_.get(), setup.type, setup.request, setup.value, setup.index, data.data(),
          static_cast<std::uint16_t>(data.size()), static_cast<unsigned>(milliseconds));
    });
    if (code < 0) throw usb_error(code, name_, "a control transfer failed");
    return code;
  }

  Clock& clock_;
  const std::string name_;
  Context context_;
  Handle handle_;
  UsbIdentity identity_;
  std::string place_;  // the node
  NodeLock lock_;
};

}  // namespace

std::unique_ptr<UsbLink> open_usb_link(const UsbAddress& address, Clock& clock) {
  return std::make_unique<LibusbLink>(address, clock);
}

// A device that may not be opened is listed without its strings.
std::vector<UsbIdentity> list_usb_devices() {
  const Context context = new_context();
  std::vector<UsbIdentity> found;
  for_each_device(context.get(),
                  [&](libusb_device* device, const libusb_device_descriptor& descriptor) {
                    libusb_device_handle* opened = nullptr;
                    if (libusb_open(device, &opened) != 0) opened = nullptr;
                    const Handle handle(opened, libusb_close);
                    found.push_back(identify(device, descriptor, opened));
                  });
  return found;
}

}  // namespace vitreo
