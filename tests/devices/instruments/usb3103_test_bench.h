// A USB-3103 emulator whose every report is written down, with cables and answers that can go bad.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/links/hid_link.h"
#include "devices/time/clock.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::usb3103 {

/// An emulator, listened to; `answer` may answer in its place.
struct Bench : HidPeer {
  using Answer = std::function<std::optional<std::vector<Report>>(Bytes)>;

  explicit Bench(const EmulatorSettings& settings = {})
      : emulator(
            make_emulator(settings, [this](const Voltages& volts) { steps.push_back(volts); })) {}

  std::vector<Report> receive(Bytes report) override {
    sent.emplace_back(report.begin(), report.end());
    if (answer)
      if (auto replies = answer(report)) return *std::move(replies);
    return emulator->receive(report);
  }
  const Voltages& outputs() const { return emulator->outputs(); }
  /// Answers every report with the command `id` by `replies`.
  void answer_with(std::uint8_t id, std::vector<Report> replies) {
    answer = [id, replies](Bytes report) {
      return report[0] == id ? std::optional(replies) : std::nullopt;
    };
  }

  std::vector<Report> sent;
  std::vector<Voltages> steps;
  Answer answer;
  std::unique_ptr<Emulator> emulator;
};

/// A cable that can be pulled after a number of writes, and put back.
struct Cable {
  int writes_left = -1;  // negative: sound
};

class LooseLink final : public HidLink {
 public:
  LooseLink(std::unique_ptr<HidLink> link, Cable& cable) : link_(std::move(link)), cable_(cable) {}
  void write(std::span<const std::uint8_t> report) override {
    fail_when_pulled();
    if (cable_.writes_left > 0) --cable_.writes_left;
    link_->write(report);
  }
  std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
    fail_when_pulled();
    return link_->read(timeout);
  }

 private:
  void fail_when_pulled() const {
    if (cable_.writes_left == 0)
      throw DeviceError(DeviceErrorKind::lost, "hid:09db:009c", "no such device");
  }
  std::unique_ptr<HidLink> link_;
  Cable& cable_;
};

using Currents = std::vector<double>;
constexpr Time kLatency = std::chrono::milliseconds(1);
constexpr double kCount = 20. / 65536;  // V
inline const Currents kSomeCurrents{1, -1, 2.5, 12, -12, 0.1, -0.1, 6};

struct Usb3103Driver : ::testing::Test {
  std::unique_ptr<CoilAmplifier> open_on(HidPeer& peer) {
    return open(std::make_unique<LooseLink>(memory_hid_link(peer, *clock, kLatency), cable),
                settings, *clock);
  }
  /// The error of `work`, which must name the device by its role.
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device, "coils");
      EXPECT_EQ(std::string(error.what()).rfind("coils: ", 0), 0U) << error.what();
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::refused;
  }

  std::unique_ptr<Clock> clock = virtual_clock();
  Settings settings;
  Cable cable;
  Bench bench;
};

}  // namespace vitreo::usb3103
