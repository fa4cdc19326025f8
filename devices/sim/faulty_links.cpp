// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/faulty_links.h"

#include "devices/links/faulty_peers.h"
#include "devices/time/error.h"

#include <algorithm>
#include <deque>
#include <utility>

namespace vitreo::sim {
namespace {

// How often a waiting read looks whether the cable was pulled.
constexpr Time kLook = std::chrono::milliseconds(20);

void check_cable(const LinkFaults& faults, const char* bus) {
  if (faults.unplugged) throw DeviceError(DeviceErrorKind::lost, bus, "is gone");
}

// Reports in: late, cut, garbled or lost. A late report is held until it is due, and those after it
// wait in their order. Reports out: lost where the instrument is deaf.
class FaultyHidLink final : public HidLink {
 public:
  FaultyHidLink(std::unique_ptr<HidLink> link, const LinkFaults& faults, Clock& clock)
      : link_(std::move(link)), faults_(faults), clock_(clock) {}

  void write(std::span<const std::uint8_t> report) override {
    check_cable(faults_, "hid");
    if (!faults_.deaf) return link_->write(report);
    // A write to a deaf instrument is a wait like any other: the baton is passed on.
    clock_.sleep_for(Time::zero());
  }

  // In slices, since faults are set without a signal: a pulled cable must end a wait that is under
  // way.
  std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      check_cable(faults_, "hid");
      const Time slice = std::min(
          deadline, held_.empty() ? later(clock_.now(), kLook)
                                  : std::min(held_.front().due, later(clock_.now(), kLook)));
      if (auto report = link_->read(std::max(slice - clock_.now(), Time::zero()));
          report && !faults_.silent) {
        spoil(faults_, *report);
        held_.push_back({later(clock_.now(), faults_.late), std::move(*report)});
      }
      if (!held_.empty() && held_.front().due <= clock_.now()) {
        auto report = std::move(held_.front().report);
        held_.pop_front();
        return report;
      }
      if (clock_.now() >= deadline) return std::nullopt;
    }
  }
  bool hung_up() const override { return faults_.unplugged; }

 private:
  struct Held {
    Time due;
    std::vector<std::uint8_t> report;
  };
  std::unique_ptr<HidLink> link_;
  const LinkFaults& faults_;
  Clock& clock_;
  std::deque<Held> held_;
};

// Control transfers: each takes `late`, or its whole timeout when it would not be answered in time.
class FaultyUsbLink final : public UsbLink {
 public:
  FaultyUsbLink(std::unique_ptr<UsbLink> link, const LinkFaults& faults, Clock& clock)
      : link_(std::move(link)), faults_(faults), clock_(clock) {}

  const UsbIdentity& identity() const override { return link_->identity(); }
  void write(const UsbSetup& setup, std::span<const std::uint8_t> data, Time timeout) override {
    delay(timeout);
    link_->write(setup, data, timeout);
  }
  std::vector<std::uint8_t> read(const UsbSetup& setup, std::uint16_t length,
                                 Time timeout) override {
    delay(timeout);
    auto bytes = link_->read(setup, length, timeout);
    spoil(faults_, bytes);
    return bytes;
  }

 private:
  // The instrument executes what it is sent only where the answer would come in time: a transfer
  // that is lost is lost on its way there.
  void delay(Time timeout) {
    check_cable(faults_, "usb");
    if (!faults_.silent && !faults_.deaf && faults_.late == Time::zero()) return;
    const bool never = faults_.silent || faults_.deaf || faults_.late >= timeout;
    clock_.sleep_for(never ? timeout : faults_.late);
    check_cable(faults_, "usb");
    if (never)
      throw DeviceError(DeviceErrorKind::timeout, "usb", "the transfer was not answered in time");
  }

  std::unique_ptr<UsbLink> link_;
  const LinkFaults& faults_;
  Clock& clock_;
};

}  // namespace

std::unique_ptr<HidLink> faulty_hid_link(std::unique_ptr<HidLink> link, const LinkFaults& faults,
                                         Clock& clock) {
  return std::make_unique<FaultyHidLink>(std::move(link), faults, clock);
}

std::unique_ptr<UsbLink> faulty_usb_link(std::unique_ptr<UsbLink> link, const LinkFaults& faults,
                                         Clock& clock) {
  return std::make_unique<FaultyUsbLink>(std::move(link), faults, clock);
}

}  // namespace vitreo::sim
