// USB link in memory: the wire between a real driver and an emulator.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/usb_link.h"

#include "devices/links/usb_frames.h"
#include "devices/time/error.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// A transfer is one call of the peer, at the end of its frame. It is made even when the caller is
/// stopped or its deadline passes meanwhile: the device does not know of either.
class MemoryUsbLink final : public UsbLink {
 public:
  MemoryUsbLink(UsbPeer& peer, Clock& clock, Time interval)
      : peer_(peer), clock_(clock), frames_(interval) {
    if (interval < Time::zero()) throw std::invalid_argument("interval: must not be negative");
  }
  const UsbIdentity& identity() const override { return peer_.identity(); }
  void write(const UsbSetup& setup, std::span<const std::uint8_t> data, Time timeout) override {
    transfer(setup, data, 0, timeout);
  }
  std::vector<std::uint8_t> read(const UsbSetup& setup, std::uint16_t length,
                                 Time timeout) override {
    return transfer(setup, {}, length, timeout);
  }

 private:
  // The peer is asked even where the answer is not waited for any more; of the reasons to throw the
  // stop comes first, then the deadline, then the stall.
  std::vector<std::uint8_t> transfer(const UsbSetup& setup, std::span<const std::uint8_t> data,
                                     std::uint16_t length, Time timeout) {
    std::exception_ptr stopped;
    const Time deadline = later(clock_.now(), timeout);
    const Time over = frames_.next(clock_.now());
    try {
      clock_.sleep_until(std::min(over, deadline));
    } catch (const Stopped&) {
      // What is on the wire arrives, whatever becomes of the sender.
      stopped = std::current_exception();
    }
    auto answer = peer_.control(setup, data, length);
    if (stopped) std::rethrow_exception(stopped);
    const std::string device = to_string("usb", {identity().vendor, identity().product, ""});
    if (over > deadline)
      throw DeviceError(DeviceErrorKind::timeout, device, "the transfer was not over in time");
    if (!answer)
      throw DeviceError(DeviceErrorKind::refused, device, "the device stalled the transfer");
    if (answer->size() > length) answer->resize(length);
    return *std::move(answer);
  }

  UsbPeer& peer_;
  Clock& clock_;
  UsbFrames frames_;
};

}  // namespace

std::unique_ptr<UsbLink> memory_usb_link(UsbPeer& peer, Clock& clock, Time interval) {
  return std::make_unique<MemoryUsbLink>(peer, clock, interval);
}

}  // namespace vitreo
