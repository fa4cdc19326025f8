// HID devices by hidapi's hidraw back end. The only file that includes hidapi.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/hid_link.h"
#include "devices/links/node_lock.h"
#include "devices/time/error.h"
#include "devices/time/quiet_thread.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <hidapi.h>
#include <limits>
#include <mutex>
#include <thread>
#include <utility>

namespace vitreo {
namespace {

/// hidapi's strings are wide; what is not ASCII becomes '?'.
std::string narrow(const wchar_t* wide) {
  std::string text;
  for (; wide != nullptr && *wide != L'\0'; ++wide)
    text += *wide < 0x80 ? static_cast<char>(*wide) : '?';
  return text;
}

std::string last_error(hid_device* device) {
  const std::string said = narrow(hid_error(device));
  return said.empty() ? "no reason given" : said;
}

using Device = std::unique_ptr<hid_device, decltype(&hid_close)>;

/// A full-speed device takes a report within a few milliseconds; after this time it does not take
/// it at all.
constexpr std::chrono::milliseconds kWriteDeadline{500};

/// Writes reports on a thread of its own: the kernel has no deadline for them that a caller could
/// choose, and holds one for up to 5 s where a device does not take it. Shared with that thread,
/// which may outlive the link for as long.
class Writer {
 public:
  explicit Writer(Device device) : device_(std::move(device)) {}
  static std::shared_ptr<Writer> start(Device device) {
    auto writer = std::make_shared<Writer>(std::move(device));
    quiet_thread([writer] { writer->run(); }).detach();
    return writer;
  }
  // For reading, on the caller's thread, while run() may be writing.
  hid_device* device() const { return device_.get(); }
  /// A report did not leave in time, so none is taken any more.
  bool given_up() {
    const std::lock_guard lock(mutex_);
    return stuck_;
  }

  /// Bytes written; negative with the reason in `why`. Nothing at the deadline, and ever after: the
  /// report may still go out, and another behind it would come out of order. Callers take turns:
  /// there is one hand-over, and the result in it is that of one report.
  std::optional<int> write(std::span<const std::uint8_t> report, std::string& why) {
    const std::lock_guard turn(turn_);
    std::unique_lock lock(mutex_);
    if (stuck_) return std::nullopt;
    report_.emplace(report.begin(), report.end());
    changed_.notify_all();
    stuck_ = !changed_.wait_for(lock, kWriteDeadline, [this] { return !report_; });
    if (stuck_) return std::nullopt;
    why = why_;
    return written_;
  }
  void end() {
    const std::lock_guard lock(mutex_);
    ended_ = true;
    changed_.notify_all();
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [this] { return report_ || ended_; });
      if (!report_) return;
      const std::vector<std::uint8_t> report = *report_;
      lock.unlock();
      const int written = hid_write(device_.get(), report.data(), report.size());
      const std::string why = written < 0 ? last_error(device_.get()) : "";
      lock.lock();
      written_ = written;
      why_ = why;
      report_.reset();
      changed_.notify_all();
      if (stuck_) return;  // the link has given this thread up
    }
  }

  const Device device_;
  std::mutex turn_;  // of write()
  // Of all members below. report_ is the hand-over: filled by write(), emptied by run() when the
  // kernel has taken it.
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<std::vector<std::uint8_t>> report_;  // on its way
  int written_ = 0;
  std::string why_;
  bool stuck_ = false;
  bool ended_ = false;
};

/// Reads and writes block, so they run outside the clock's baton.
class HidapiLink final : public HidLink {
 public:
  HidapiLink(const UsbAddress& address, Clock& clock)
      : clock_(clock), name_(to_string("hid", address)) {
    clock_.outside([&] { open(address); });
  }
  HidapiLink(const HidapiLink&) = delete;
  HidapiLink& operator=(const HidapiLink&) = delete;
  // The thread ends by itself; while the kernel holds a report it keeps the device open for as
  // long.
  ~HidapiLink() override { writer_->end(); }

  void write(std::span<const std::uint8_t> report) override {
    if (writer_->given_up())
      throw DeviceError(DeviceErrorKind::lost, name_,
                        "the link was given up after a report that it did not take");
    std::optional<int> written;
    std::string why;
    clock_.outside([&] { written = writer_->write(report, why); });
    if (!written)
      throw DeviceError(DeviceErrorKind::timeout, name_,
                        "it took no report within 0.5 s; the link is given up");
    if (*written < 0)
      throw DeviceError(DeviceErrorKind::lost, name_, "a report cannot be sent: " + why);
    if (*written < static_cast<int>(report.size()))
      throw DeviceError(DeviceErrorKind::lost, name_, "a report was sent only in part");
  }

  std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
    // Rounded up: a deadline that is a fraction of a millisecond away has not passed.
    const auto milliseconds =
        std::clamp<std::int64_t>(std::chrono::ceil<std::chrono::milliseconds>(timeout).count(), 0,
                                 std::numeric_limits<int>::max());
    std::array<std::uint8_t, kLargest> bytes{};
    int size = 0;
    std::string why;
    clock_.outside([&] {
      // Of two readers that poll() woke for one report, hidapi would let one wait for ever.
      const std::lock_guard lock(reading_);
      size = hid_read_timeout(writer_->device(), bytes.data(), bytes.size(),
                              static_cast<int>(milliseconds));
      if (size < 0) why = last_error(writer_->device());
    });
    if (size < 0) throw DeviceError(DeviceErrorKind::lost, name_, "nothing can be read: " + why);
    if (size == 0) return std::nullopt;
    return std::vector<std::uint8_t>(bytes.begin(), bytes.begin() + size);
  }
  // hidapi does not give its own descriptor away.
  bool hung_up() const override { return lock_.hung_up(); }

 private:
  /// Bytes of a report: the kernel's HID_MAX_BUFFER_SIZE is 16 KiB; our instruments have 64.
  static constexpr std::size_t kLargest = 4096;

  /// By the node's path: hid_open() by ids would take the first of several devices in silence.
  void open(const UsbAddress& address) {
    std::string path;
    for (const UsbIdentity& found : list_hid_devices()) {
      if (!found.matches(address)) continue;
      if (!path.empty())
        throw DeviceError(DeviceErrorKind::not_found, name_,
                          "there are several; say which by :SERIAL in the address");
      path = found.place;
    }
    if (path.empty())
      throw DeviceError(DeviceErrorKind::not_found, name_, "no such device is plugged in");
    NodeLock lock(path, name_);
    Device device(hid_open_path(path.c_str()), hid_close);
    if (!device)
      throw DeviceError(DeviceErrorKind::refused, name_,
                        path + " may not be opened: " + last_error(nullptr));
    writer_ = Writer::start(std::move(device));
    lock_ = std::move(lock);
  }

  Clock& clock_;
  const std::string name_;
  std::shared_ptr<Writer> writer_;  // owns the device
  // The link's, not the writer's: who gives up a link on which a report is stuck opens it anew.
  NodeLock lock_;
  std::mutex reading_;
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
    if (std::none_of(found.begin(), found.end(),
                     [&](const UsbIdentity& f) { return f.place == identity.place; }))
      found.push_back(std::move(identity));
  }
  return found;
}

}  // namespace vitreo
