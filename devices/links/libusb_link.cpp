// USB control transfers by libusb.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/libusb_device.h"
#include "devices/links/usb_link.h"
#include "devices/time/error.h"

namespace vitreo {
namespace {

/// Transfers block, so they run outside the clock's baton. A context of its own each: no state is
/// shared between links.
class LibusbLink final : public UsbLink {
 public:
  LibusbLink(const UsbAddress& address, Clock& clock)
      : clock_(clock), name_(to_string("usb", address)) {
    clock_.outside([&] {
      own_ = open_own_usb_device(
          address.vendor, address.product,
          [&](const UsbIdentity& found) { return found.matches(address); }, name_);
    });
  }
  const UsbIdentity& identity() const override { return own_.identity; }

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
  int transfer(const UsbSetup& setup, std::vector<std::uint8_t>& data, Time timeout) {
    int code = 0;
    clock_.outside([&] {
      code = libusb_control_transfer(
          own_.handle.get(), setup.type, setup.request, setup.value, setup.index, data.data(),
          static_cast<std::uint16_t>(data.size()), usb_milliseconds(timeout));
    });
    if (code < 0) throw usb_error(code, name_, "a control transfer failed");
    return code;
  }

  Clock& clock_;
  const std::string name_;
  OwnUsbDevice own_;
};

}  // namespace

std::unique_ptr<UsbLink> open_usb_link(const UsbAddress& address, Clock& clock) {
  return std::make_unique<LibusbLink>(address, clock);
}

// A device that may not be opened is listed without its strings.
std::vector<UsbIdentity> list_usb_devices() {
  const UsbContext context = new_usb_context();
  std::vector<UsbIdentity> found;
  for_each_usb_device(context.get(),
                      [&](libusb_device* device, const libusb_device_descriptor& descriptor) {
                        libusb_device_handle* opened = nullptr;
                        if (libusb_open(device, &opened) != 0) opened = nullptr;
                        const UsbHandle handle(opened, libusb_close);
                        found.push_back(identify_usb(device, descriptor, opened));
                      });
  return found;
}

}  // namespace vitreo
