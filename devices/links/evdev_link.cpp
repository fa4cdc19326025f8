// Input devices by libevdev and the kernel's evdev nodes. The only file that includes libevdev.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/event_link.h"
#include "devices/links/file_link.h"
#include "devices/links/node_lock.h"
#include "devices/links/polling.h"
#include "devices/links/usb_address.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cerrno>
#include <fcntl.h>
#include <libevdev/libevdev.h>
#include <poll.h>
#include <system_error>
#include <time.h>
#include <utility>

namespace vitreo {
namespace {

using Evdev = std::unique_ptr<libevdev, decltype(&libevdev_free)>;

/// The node of the device with these numbers.
std::string event_node_of(const UsbAddress& wanted, const std::string& address) {
  std::vector<EventNode> found;
  for (const EventNode& one : list_event_nodes())
    if (one.vendor == wanted.vendor && one.product == wanted.product &&
        (wanted.serial.empty() || one.serial == wanted.serial))
      found.push_back(one);
  // A pad may have nodes for its motion sensors and its touch pad too.
  if (found.size() > 1) std::erase_if(found, [](const EventNode& one) { return !one.pad; });
  if (found.empty())
    throw DeviceError(DeviceErrorKind::not_found, address, "no such device is plugged in");
  if (found.size() > 1)
    throw DeviceError(DeviceErrorKind::not_found, address,
                      "there are several; say which by :SERIAL in the address, or by its node");
  return found.front().node;
}

/// The kernel's name, or the number where it has none.
std::string event_name(unsigned type, unsigned code) {
  const char* const name = libevdev_event_code_get_name(type, code);
  return name != nullptr ? name : (type == EV_KEY ? "KEY_" : "ABS_") + std::to_string(code);
}

/// A device and the numbers of its axes and buttons, in their order.
struct OpenDevice {
  std::unique_ptr<OpenFile> file{};
  Evdev evdev{nullptr, libevdev_free};  // does not close the file
  NodeLock lock{};
  EventDevice device{};
  std::vector<unsigned> axes{};
  std::vector<unsigned> buttons{};
};

void describe(OpenDevice& opened) {
  libevdev* const evdev = opened.evdev.get();
  const auto text = [](const char* own) { return own == nullptr ? std::string() : own; };
  opened.device = {text(libevdev_get_name(evdev)),
                   static_cast<std::uint16_t>(libevdev_get_id_vendor(evdev)),
                   static_cast<std::uint16_t>(libevdev_get_id_product(evdev)),
                   text(libevdev_get_uniq(evdev)),
                   {},
                   {}};
  for (unsigned code = 0; code <= ABS_MAX; ++code) {
    const input_absinfo* const axis = libevdev_get_abs_info(evdev, code);
    if (axis == nullptr || !libevdev_has_event_code(evdev, EV_ABS, code)) continue;
    opened.axes.push_back(code);
    opened.device.axes.push_back(
        {event_name(EV_ABS, code), axis->minimum, axis->maximum, axis->flat});
  }
  for (unsigned code = 0; code <= KEY_MAX; ++code) {
    if (!libevdev_has_event_code(evdev, EV_KEY, code)) continue;
    opened.buttons.push_back(code);
    opened.device.buttons.push_back(event_name(EV_KEY, code));
  }
}

OpenDevice open_node(const std::string& node, const std::string& address) {
  OpenDevice opened;
  const int handle = ::open(node.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (handle < 0)
    throw DeviceError(
        errno == EACCES || errno == EPERM ? DeviceErrorKind::refused : DeviceErrorKind::not_found,
        address, node + ": " + system_error());
  opened.file = own_descriptor(handle);
  opened.lock = NodeLock(node, address);
  libevdev* evdev = nullptr;
  if (const int code = libevdev_new_from_fd(handle, &evdev); code != 0)
    throw DeviceError(DeviceErrorKind::not_found, address,
                      node + " is no input device: " + std::generic_category().message(-code));
  opened.evdev.reset(evdev);
  if (const int code = libevdev_grab(evdev, LIBEVDEV_GRAB); code == -EBUSY)
    throw OwnedError(address);
  libevdev_set_clock_id(evdev, CLOCK_MONOTONIC);
  describe(opened);
  return opened;
}

Time monotonic_now() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec);
}

// libevdev keeps the present values, and asks the kernel for them anew where events were dropped
// (SYN_DROPPED): a button that was released meanwhile is released.
class EvdevLink final : public EventLink {
 public:
  EvdevLink(std::string place, Clock& clock)
      : place_(std::move(place)), address_("evdev:" + place_), clock_(clock) {
    if (!place_.starts_with("/dev/")) numbers_ = parse_usb_address("evdev", address_);
    opened_ = open();
    device_ = opened_.device;
    read_values();
  }
  const std::string& address() const override { return address_; }
  const EventDevice& device() const override { return device_; }

  const EventState& state() override {
    take_events();
    changed_ = false;
    return state_;
  }

  bool wait(Time timeout) override {
    Polling polling(clock_, timeout);
    for (;;) {
      take_events();
      if (changed_) return true;
      if (!polling.again()) return false;
    }
  }

  void reopen() override {
    opened_ = {};
    OpenDevice opened = open();
    if (opened.device != device_)
      throw DeviceError(DeviceErrorKind::not_found, address_,
                        "another device is there: " + opened.device.name);
    opened_ = std::move(opened);
    read_values();
  }

 private:
  OpenDevice open() const {
    return open_node(place_.starts_with("/dev/") ? place_ : event_node_of(numbers_, address_),
                     address_);
  }

  [[noreturn]] void lose(const std::string& why) {
    opened_ = {};
    throw DeviceError(DeviceErrorKind::lost, address_, why);
  }

  /// poll() first: a device that is gone hangs up, which a read of no events would not show.
  void take_events() {
    if (!opened_.file) lose("it is closed");
    pollfd file{opened_.file->handle(), POLLIN, 0};
    if (::poll(&file, 1, 0) > 0 && (file.revents & (POLLERR | POLLHUP | POLLNVAL)) != 0)
      lose("is gone");
    unsigned flag = LIBEVDEV_READ_FLAG_NORMAL;
    for (;;) {
      input_event event{};
      const int code = libevdev_next_event(opened_.evdev.get(), flag, &event);
      // In a synchronization -EAGAIN is its end.
      if (code == -EAGAIN && flag == LIBEVDEV_READ_FLAG_NORMAL) break;
      if (code == -EAGAIN) flag = LIBEVDEV_READ_FLAG_NORMAL;
      if (code == -EAGAIN) continue;
      if (code < 0) lose(std::generic_category().message(-code));
      if (code == LIBEVDEV_READ_STATUS_SYNC) flag = LIBEVDEV_READ_FLAG_SYNC;
      note(event);
    }
    if (changed_) read_values();
  }

  void note(const input_event& event) {
    if (event.type != EV_ABS && event.type != EV_KEY) return;
    changed_ = true;
    const Time stamp = std::chrono::seconds(event.input_event_sec) +
                       std::chrono::microseconds(event.input_event_usec);
    const Time age = std::max(monotonic_now() - stamp, Time::zero());
    state_.at = std::max(clock_.now() - age, Time::zero());
  }

  void read_values() {
    state_.axes.clear();
    state_.pressed.clear();
    for (const unsigned code : opened_.axes)
      state_.axes.push_back(libevdev_get_event_value(opened_.evdev.get(), EV_ABS, code));
    for (const unsigned code : opened_.buttons)
      state_.pressed.push_back(libevdev_get_event_value(opened_.evdev.get(), EV_KEY, code) != 0);
  }

  const std::string place_;
  const std::string address_;
  Clock& clock_;
  UsbAddress numbers_{};
  OpenDevice opened_;  // empty once it was lost
  EventDevice device_;
  EventState state_;
  bool changed_ = false;  // since state() was asked last
};

}  // namespace

std::unique_ptr<EventLink> open_evdev(const std::string& place, Clock& clock) {
  return std::make_unique<EvdevLink>(place, clock);
}

}  // namespace vitreo
