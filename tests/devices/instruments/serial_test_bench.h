// Test bench of serial instruments: a clock, a link that can go bad, a log of what was sent.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/clock.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace vitreo {

/// Passes everything on to an emulator, and writes down what the host says.
struct Listener final : BytePeer {
  explicit Listener(BytePeer& its_peer) : peer(its_peer) {}
  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    heard.append(bytes.begin(), bytes.end());
    peer.receive(bytes, now);
  }
  std::vector<TimedBytes> say(Time now) override { return peer.say(now); }
  Time next() const override { return peer.next(); }
  /// How often the host said so.
  int count(std::string_view text) const {
    int found = 0;
    for (std::size_t at = heard.find(text); at != std::string::npos; at = heard.find(text, at + 1))
      ++found;
    return found;
  }

  BytePeer& peer;
  std::string heard;
};

/// Something else at the other end, that answers everything in the same way.
struct Stranger final : BytePeer {
  explicit Stranger(std::string its_answer) : answer(std::move(its_answer)) {}
  void receive(std::span<const std::uint8_t>, Time now) override {
    said.push_back({now, {answer.begin(), answer.end()}});
  }
  std::vector<TimedBytes> say(Time) override { return std::exchange(said, {}); }
  Time next() const override { return said.empty() ? kForever : said.front().at; }
  std::string answer;
  std::vector<TimedBytes> said;
};

struct SerialBench : ::testing::Test {
  /// As a serial port at 9600 baud would be.
  std::unique_ptr<ByteLink> link_to(BytePeer& peer) {
    return memory_byte_link(
        peer, *clock, {std::chrono::microseconds(200), std::chrono::microseconds(1042)}, &faults);
  }
  /// The error of `work`, which must name the device by its role; `saying` stands in its text.
  DeviceErrorKind kind_of(const std::function<void()>& work, const std::string& saying = "") {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device, name);
      EXPECT_EQ(std::string(error.what()).rfind(name + ": ", 0), 0U) << error.what();
      EXPECT_NE(std::string(error.what()).find(saying), std::string::npos) << error.what();
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::not_found;
  }

  std::string name = "stage";
  std::unique_ptr<Clock> clock = virtual_clock();
  LinkFaults faults;
};

}  // namespace vitreo
