// The HID link in memory: latency, deadlines, and reports that outlive their sender. And what
// device errors say.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/hid_link.h"

#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Report = std::vector<std::uint8_t>;

/// Answers each report by `copies` of it.
struct Echo : HidPeer {
  std::vector<Report> receive(std::span<const std::uint8_t> report) override {
    received.emplace_back(report.begin(), report.end());
    return std::vector<Report>(copies, received.back());
  }
  std::vector<Report> received;
  std::size_t copies = 1;
};

struct MemoryHidLink : ::testing::Test {
  std::unique_ptr<Clock> clock = virtual_clock();
  Echo echo;
  std::unique_ptr<HidLink> link = memory_hid_link(echo, *clock, 2ms);
};

TEST_F(MemoryHidLink, TakesItsTimeBothWays) {
  link->write(Report{1, 2});
  EXPECT_EQ(clock->now(), 2ms);
  EXPECT_EQ(link->read(1s), (Report{1, 2}));
  EXPECT_EQ(clock->now(), 4ms);
}

TEST_F(MemoryHidLink, KeepsRepliesInOrder) {
  echo.copies = 2;
  link->write(Report{1, 0});
  link->write(Report{2, 0});
  for (const Report& expected : {Report{1, 0}, Report{1, 0}, Report{2, 0}, Report{2, 0}})
    EXPECT_EQ(link->read(1s), expected);
  EXPECT_FALSE(link->read(0ms));
}

TEST_F(MemoryHidLink, ReturnsNothingAtTheDeadline) {
  EXPECT_FALSE(link->read(30ms));
  EXPECT_EQ(clock->now(), 30ms);
  link->write(Report{1, 0});
  EXPECT_FALSE(link->read(1ms));  // the reply is still on its way
  EXPECT_EQ(clock->now(), 33ms);
  EXPECT_EQ(link->read(1ms), (Report{1, 0}));
}

TEST_F(MemoryHidLink, WakesAReaderInAnotherTask) {
  std::optional<Report> heard;
  const auto reader = clock->spawn("reader", [&] { heard = link->read(kForever); });
  clock->sleep_for(1s);
  link->write(Report{7, 0});
  reader->join();
  EXPECT_EQ(heard, (Report{7, 0}));
  EXPECT_EQ(clock->now(), 1s + 4ms);
}

TEST_F(MemoryHidLink, DeliversWhatAStoppedTaskSends) {
  clock->interrupt();
  EXPECT_THROW(link->write(Report{9, 0}), Stopped);
  EXPECT_EQ(echo.received, (std::vector<Report>{{9, 0}}));
}

TEST_F(MemoryHidLink, RefusesANegativeLatency) {
  EXPECT_THROW(memory_hid_link(echo, *clock, -1ns), std::invalid_argument);
}

TEST(DeviceError, SaysWhoWhatAndHow) {
  const DeviceError error(DeviceErrorKind::timeout, "coils", "no answer");
  EXPECT_STREQ(error.what(), "coils: no answer (timeout)");
  EXPECT_EQ(error.kind, DeviceErrorKind::timeout);
  EXPECT_EQ(error.device, "coils");
  EXPECT_STREQ(to_string(DeviceErrorKind::not_found), "not found");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
