// HID devices by hidapi's hidraw back end. The only file that knows hidapi.
// SPDX-License-Identifier: Apache-2.0
#include "devices/error.h"
#include "devices/hid_link.h"

#include <algorithm>
#include <array>
#include <hidapi.h>
#include <limits>

namespace vitreo {
namespace {

std::string narrow(const wchar_t* wide) {
  std::string text;
  for (; wide != nullptr && *wide != L'\0'; ++wide) text += *wide < 0x80 ? static_cast<char>(*wide) : '?';
  return text;
}

std::string last_error(hid_device* device) {
  const std::string said = narrow(hid_error(device));
  return said.empty() ? "no reason given" : said;
}

class HidapiLink final : public HidLink {
 public:
  HidapiLink(const UsbAddress& address, Clock& clock)
      : clock_(clock), name_(to_string("hid", address)), device_(nullptr, hid_close) {
    clock_.outside([&] { open(address); });
  }

  void write(std::span<const std::uint8_t> report) override {
    int written = 0;
    std::string why;
    clock_.outside([&] {
      written = hid_write(device_.get(), report.data(), report.size());
      if (written < 0) why = last_error(device_.get());
    });
    if (written < 0) throw DeviceError(DeviceErrorKind::lost, name_, "a report cannot be sent: " + why);
    if (written < static_cast<int>(report.size()))
      throw DeviceError(DeviceErrorKind::lost, name_, "a report was sent only in part");
  }

  std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
    // Rounded up: a deadline that is a fraction of a millisecond away has not passed.
    const auto milliseconds = std::clamp<std::int64_t>(std::chrono::ceil<std::chrono::milliseconds>(timeout).count(), 0,
                                                       std::numeric_limits<int>::max());
    std::array<std::uint8_t, kLargest> bytes{};
    int size = 0;
    std::string why;
    clock_.outside([&] {
      size = hid_read_timeout(device_.get(), bytes.data(), bytes.size(), static_cast<int>(milliseconds));
      if (size < 0) why = last_error(device_.get());
    });
    if (size < 0) throw DeviceError(DeviceErrorKind::lost, name_, "nothing can be read: " + why);
    if (size == 0) return std::nullopt;
    return std::vector<std::uint8_t>(bytes.begin(), bytes.begin() + size);
  }

 private:
  static constexpr std::size_t kLargest = 4096;  // HID_MAX_BUFFER_SIZE of the kernel is 16 KiB; ours have 64 bytes

  void open(const UsbAddress& address) {
    std::string path;
    for (const UsbIdentity& found : list_hid_devices()) {
      if (!found.matches(address)) continue;
      if (!path.empty())
        throw DeviceError(DeviceErrorKind::not_found, name_, "there are several; say which by :SERIAL in the address");
      path = found.place;
    }
    if (path.empty()) throw DeviceError(DeviceErrorKind::not_found, name_, "no such device is plugged in");
    device_.reset(hid_open_path(path.c_str()));
    if (!device_)
      throw DeviceError(DeviceErrorKind::refused, name_, path + " may not be opened: " + last_error(nullptr));
  }

  Clock& clock_;
  const std::string name_;
  std::unique_ptr<hid_device, decltype(&hid_close)> device_;
};

}  // namespace

std::unique_ptr<HidLink> open_hid_link(const UsbAddress& address, Clock& clock) {
  return std::make_unique<HidapiLink>(address, clock);
}

std::vector<UsbIdentity> list_hid_devices() {
  std::vector<UsbIdentity> found;
  const std::unique_ptr<hid_device_info, decltype(&hid_free_enumeration)> all(hid_enumerate(0, 0),
                                                                              hid_free_enumeration);
  for (const hid_device_info* one = all.get(); one != nullptr; one = one->next) {
    UsbIdentity identity{one->vendor_id,
                         one->product_id,
                         one->release_number,
                         narrow(one->serial_number),
                         narrow(one->manufacturer_string),
                         narrow(one->product_string),
                         one->path};
    // A device comes once for each usage of its descriptor, all with the same node.
    if (std::none_of(found.begin(), found.end(), [&](const UsbIdentity& f) { return f.place == identity.place; }))
      found.push_back(std::move(identity));
  }
  return found;
}

}  // namespace vitreo
