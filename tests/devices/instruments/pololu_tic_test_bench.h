// A Tic emulator whose every transfer is written down, with cables and answers that can go bad.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/pololu_tic/driver.h"
#include "devices/instruments/pololu_tic/emulator.h"
#include "devices/instruments/pololu_tic/wire.h"
#include "devices/time/clock.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace vitreo::pololu_tic {

using namespace std::chrono_literals;

/// An emulator, listened to; `answer` may answer in its place.
struct Bench final : UsbPeer {
  using Bytes_ = std::vector<std::uint8_t>;
  Bench(const Clock& clock, const EmulatorSettings& settings)
      : emulator(make_emulator(settings, clock)) {}
  const UsbIdentity& identity() const override { return emulator->identity(); }
  std::optional<Bytes_> control(const UsbSetup& setup, std::span<const std::uint8_t> data,
                                std::uint16_t length) override {
    sent.push_back(setup);
    auto right = emulator->control(setup, data, length);
    return answer ? answer(setup, std::move(right)) : right;
  }
  long count(Code code) const {
    return std::count_if(sent.begin(), sent.end(), [code](const UsbSetup& one) {
      return one.request == static_cast<std::uint8_t>(code);
    });
  }
  std::vector<UsbSetup> sent;
  std::function<std::optional<Bytes_>(const UsbSetup&, std::optional<Bytes_>)> answer;
  std::unique_ptr<Emulator> emulator;
};

/// Fails as libusb does, from the moment that `failure` is set.
class LooseUsbLink final : public UsbLink {
 public:
  LooseUsbLink(std::unique_ptr<UsbLink> link, const std::optional<DeviceErrorKind>& failure)
      : link_(std::move(link)), failure_(failure) {}
  const UsbIdentity& identity() const override { return link_->identity(); }
  void write(const UsbSetup& setup, std::span<const std::uint8_t> data, Time timeout) override {
    fail();
    link_->write(setup, data, timeout);
  }
  std::vector<std::uint8_t> read(const UsbSetup& setup, std::uint16_t length,
                                 Time timeout) override {
    fail();
    return link_->read(setup, length, timeout);
  }

 private:
  void fail() const {
    if (failure_) throw DeviceError(*failure_, "usb:1ffb:00b3", "a control transfer failed");
  }
  std::unique_ptr<UsbLink> link_;
  const std::optional<DeviceErrorKind>& failure_;
};

struct TicDriver : ::testing::Test {
  static EmulatorSettings fresh() {
    EmulatorSettings settings;
    settings.home_usteps = -16000;  // 10 mm below where it stands
    return settings;
  }
  std::unique_ptr<LensMover> open_it() {
    return open(std::make_unique<LooseUsbLink>(memory_usb_link(bench, *clock, 300us), failure),
                settings, *clock);
  }
  std::unique_ptr<LensMover> open_homed() {
    auto lens = open_it();
    lens->home(60s);
    return lens;
  }
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device, "lens_mover");
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::refused;
  }
  /// m, from where it stood at first.
  double lens() {
    return bench.emulator->motor_usteps() * settings.step_length / settings.usteps_per_step;
  }

  std::unique_ptr<Clock> clock = virtual_clock();
  Settings settings;
  std::optional<DeviceErrorKind> failure;
  Bench bench{*clock, fresh()};
};

}  // namespace vitreo::pololu_tic
