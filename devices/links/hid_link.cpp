// HID link in memory: the wire between a real driver and an emulator.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/hid_link.h"

#include "devices/links/usb_frames.h"
#include "devices/time/error.h"

#include <deque>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// Reports keep their order and their boundaries; either way each has a frame of its own.
class MemoryHidLink final : public HidLink {
 public:
  MemoryHidLink(HidPeer& peer, Clock& clock, Time interval)
      : peer_(peer), clock_(clock), out_(interval), in_(interval) {
    if (interval < Time::zero()) throw std::invalid_argument("interval: must not be negative");
    peer_.connect([this](std::vector<std::uint8_t> report) { put(std::move(report)); });
  }
  MemoryHidLink(const MemoryHidLink&) = delete;
  MemoryHidLink& operator=(const MemoryHidLink&) = delete;
  ~MemoryHidLink() override { peer_.connect(nullptr); }

  // The caller's task waits for the frame; stopping it does not stop the report.
  // As Linux' hidraw, which refuses a report of one byte (hidraw_send_report: EINVAL).
  void write(std::span<const std::uint8_t> report) override {
    if (report.size() < 2)
      throw DeviceError(DeviceErrorKind::lost, "hid", "a report cannot be sent: it is too short");
    try {
      clock_.sleep_until(out_.next(clock_.now()));
    } catch (const Stopped&) {
      deliver(report);  // what is on the wire arrives, whatever becomes of the sender
      throw;
    }
    deliver(report);
  }

  std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    // A report may be in the queue and still on its way: then this waits for it as well.
    while (clock_.wait(
        arrival_, [this] { return !replies_.empty(); }, deadline)) {
      const Time due = replies_.front().due;
      if (due > deadline) break;
      clock_.sleep_until(due);
      if (replies_.empty()) continue;  // another reader took it
      auto report = std::move(replies_.front().report);
      replies_.pop_front();
      return report;
    }
    clock_.sleep_until(deadline);  // the queue held only what comes too late
    return std::nullopt;
  }

 private:
  struct Reply {
    Time due;
    std::vector<std::uint8_t> report;
  };

  /// The peer answers at once; its answers are on their way from now on.
  void deliver(std::span<const std::uint8_t> report) {
    for (auto& reply : peer_.receive(report)) put(std::move(reply));
  }
  void put(std::vector<std::uint8_t> report) {
    replies_.push_back({in_.next(clock_.now()), std::move(report)});
    clock_.notify(arrival_);
  }

  HidPeer& peer_;
  Clock& clock_;
  UsbFrames out_;
  UsbFrames in_;
  std::deque<Reply> replies_;
  Signal arrival_;
};

}  // namespace

std::unique_ptr<HidLink> memory_hid_link(HidPeer& peer, Clock& clock, Time interval) {
  return std::make_unique<MemoryHidLink>(peer, clock, interval);
}

}  // namespace vitreo
