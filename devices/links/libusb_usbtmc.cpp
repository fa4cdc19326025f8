// Transfers of a USBTMC interface by libusb.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/libusb_device.h"
#include "devices/links/usbtmc_frames.h"
#include "devices/links/usbtmc_link.h"
#include "devices/time/error.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// After so much of a wait a stop comes through.
constexpr Time kReadSlice = std::chrono::milliseconds(100);

/// Which device, and which of those that fit.
struct Wanted {
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::function<bool(const UsbIdentity&)> fits;
};

std::string first_line(const fs::path& file) {
  std::ifstream stream(file);
  std::string line;
  std::getline(stream, line);
  return line;
}

/// The device behind the kernel's node: its interface is /sys/class/usbmisc/usbtmc0/device, the
/// device the folder above.
Wanted behind_node(const std::string& node, const std::string& address) {
  const fs::path interface = fs::path("/sys/class/usbmisc") / fs::path(node).filename() / "device";
  std::error_code none;
  const fs::path device = fs::canonical(interface, none).parent_path();
  if (none || !fs::exists(device / "idVendor", none))
    throw DeviceError(DeviceErrorKind::not_found, address, "no such device is plugged in");
  const auto number = [&](const char* file, int base) {
    return std::stoi(first_line(device / file), nullptr, base);
  };
  const std::string place = "bus " + std::to_string(number("busnum", 10)) + " device " +
                            std::to_string(number("devnum", 10));
  return {static_cast<std::uint16_t>(number("idVendor", 16)),
          static_cast<std::uint16_t>(number("idProduct", 16)),
          [place](const UsbIdentity& found) { return found.place == place; }};
}

Wanted wanted_at(const std::string& place, const std::string& address) {
  if (place.starts_with("/dev/")) return behind_node(place, address);
  const UsbAddress usb = parse_usb_address("usbtmc", address);
  return {usb.vendor, usb.product, [usb](const UsbIdentity& found) { return found.matches(usb); }};
}

// Transfers block, so they run outside the clock's baton.
class LibusbPipe final : public UsbtmcPipe {
 public:
  LibusbPipe(std::string place, Clock& clock)
      : place_(std::move(place)), address_("usbtmc:" + place_), clock_(clock) {
    if (!place_.starts_with("/dev/")) parse_usb_address("usbtmc", address_);
    reopen();
  }
  const std::string& address() const override { return address_; }
  std::uint8_t interface_number() const override { return interface_; }
  std::uint8_t out_endpoint() const override { return out_; }
  std::uint8_t in_endpoint() const override { return in_; }

  void out(std::span<const std::uint8_t> transfer, Time timeout) override {
    ByteString copy(transfer.begin(), transfer.end());
    const Moved moved = bulk(out_, copy, timeout);
    if (moved.code != 0) fail(moved.code, "a message cannot be sent");
    if (moved.size != copy.size())
      throw DeviceError(DeviceErrorKind::timeout, address_, "it took only a part of a message");
  }

  In in(std::size_t most, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      ByteString bytes(most);
      const Time left = std::max(deadline - clock_.now(), Time::zero());
      const Moved moved = bulk(in_, bytes, std::min(left, kReadSlice));
      bytes.resize(moved.size);
      if (moved.code == 0) return {std::move(bytes), true};
      if (moved.code != LIBUSB_ERROR_TIMEOUT) {
        if (moved.code == LIBUSB_ERROR_PIPE) clear_halt(in_);
        fail(moved.code, "nothing can be read");
      }
      if (!bytes.empty() || clock_.now() >= deadline) return {std::move(bytes), false};
      clock_.sleep_for(Time::zero());
    }
  }

  ByteString control(const UsbSetup& setup, std::uint16_t length, Time timeout) override {
    ByteString bytes(length);
    int code = 0;
    on_handle([&](libusb_device_handle* handle) {
      code = libusb_control_transfer(handle, setup.type, setup.request, setup.value, setup.index,
                                     bytes.data(), length, usb_milliseconds(timeout));
    });
    if (code < 0) fail(code, "a request of the class failed");
    bytes.resize(static_cast<std::size_t>(code));
    return bytes;
  }

  void clear_halt(std::uint8_t endpoint) override {
    int code = 0;
    on_handle([&](libusb_device_handle* handle) { code = libusb_clear_halt(handle, endpoint); });
    if (code != 0) fail(code, "a halted endpoint cannot be cleared");
  }

  void reopen() override {
    own_ = {};
    clock_.outside([&] {
      const Wanted wanted = wanted_at(place_, address_);
      OwnUsbDevice device =
          open_own_usb_device(wanted.vendor, wanted.product, wanted.fits, address_);
      find_endpoints(device);
      // The kernel's own driver of the class has it, where that is loaded; it gets it back.
      libusb_set_auto_detach_kernel_driver(device.handle.get(), 1);
      if (const int code = libusb_claim_interface(device.handle.get(), interface_); code != 0)
        throw usb_error(code, address_, "its interface cannot be had");
      own_ = std::move(device);
    });
  }

 private:
  struct Moved {
    int code = 0;
    std::size_t size = 0;
  };
  Moved bulk(std::uint8_t endpoint, ByteString& bytes, Time timeout) {
    Moved moved;
    int count = 0;
    on_handle([&](libusb_device_handle* handle) {
      moved.code =
          libusb_bulk_transfer(handle, endpoint, bytes.data(), static_cast<int>(bytes.size()),
                               &count, usb_milliseconds(timeout));
    });
    moved.size = static_cast<std::size_t>(count);
    return moved;
  }
  template <class Work>
  void on_handle(const Work& work) {
    if (!own_.handle) throw DeviceError(DeviceErrorKind::lost, address_, "it is closed");
    clock_.outside([&] { work(own_.handle.get()); });
  }
  [[noreturn]] void fail(int code, const char* what) {
    const DeviceError error = usb_error(code, address_, what);
    if (error.kind == DeviceErrorKind::lost) own_ = {};
    throw error;
  }

  void find_endpoints(const OwnUsbDevice& device) {
    libusb_config_descriptor* found = nullptr;
    if (const int code =
            libusb_get_active_config_descriptor(libusb_get_device(device.handle.get()), &found);
        code != 0)
      throw usb_error(code, address_, "its descriptors cannot be read");
    const std::unique_ptr<libusb_config_descriptor, decltype(&libusb_free_config_descriptor)>
        configuration(found, libusb_free_config_descriptor);
    out_ = in_ = 0;
    for (int i = 0; i < configuration->bNumInterfaces; ++i) {
      const libusb_interface_descriptor& one = configuration->interface[i].altsetting[0];
      if (one.bInterfaceClass == usbtmc::kClass && one.bInterfaceSubClass == usbtmc::kSubclass)
        take_endpoints(one);
    }
    if (out_ == 0 || in_ == 0)
      throw DeviceError(DeviceErrorKind::not_found, address_,
                        "it is there, but has no interface of the class USBTMC");
  }
  void take_endpoints(const libusb_interface_descriptor& one) {
    interface_ = one.bInterfaceNumber;
    for (int i = 0; i < one.bNumEndpoints; ++i) {
      const libusb_endpoint_descriptor& endpoint = one.endpoint[i];
      if ((endpoint.bmAttributes & 3) != LIBUSB_TRANSFER_TYPE_BULK) continue;
      (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN ? in_ : out_) = endpoint.bEndpointAddress;
    }
  }

  const std::string place_;
  const std::string address_;
  Clock& clock_;
  OwnUsbDevice own_;  // closed once it was lost
  std::uint8_t interface_ = 0;
  std::uint8_t out_ = 0;
  std::uint8_t in_ = 0;
};

}  // namespace

std::unique_ptr<UsbtmcPipe> open_usbtmc_pipe(const std::string& place, Clock& clock) {
  return std::make_unique<LibusbPipe>(place, clock);
}

}  // namespace vitreo
