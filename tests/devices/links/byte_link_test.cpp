// The byte link in memory: time on the wire, and each of its faults.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/byte_link.h"

#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <numeric>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct MemoryByteLink : ::testing::Test {
  std::unique_ptr<ByteLink> link_to(EchoPeer& peer, const MemoryLinkSettings& settings = {}) {
    return memory_byte_link(peer, *clock, settings, &faults);
  }
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device, "emulated");
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::refused;
  }
  ByteString all(ByteLink& link, Time timeout = 1s) {
    ByteString got;
    for (ByteString part; !(part = link.read(100, timeout)).empty();)
      got.insert(got.end(), part.begin(), part.end());
    return got;
  }

  std::unique_ptr<Clock> clock = virtual_clock();
  LinkFaults faults;
};

TEST_F(MemoryByteLink, CarriesEveryByteBothWays) {
  EchoPeer peer;
  const auto link = link_to(peer);
  ByteString every(256);
  std::iota(every.begin(), every.end(), std::uint8_t{0});
  link->write(every, 1s);
  EXPECT_EQ(peer.heard, every);
  EXPECT_EQ(link->read(1000, 1s), every);
  EXPECT_EQ(clock->now(), 0s);
}

TEST_F(MemoryByteLink, TakesTheTimeOfTheWireAndOfTheBaudRate) {
  EchoPeer peer(3ms);
  const auto link = link_to(peer, {2ms, 1ms});
  link->write(bytes("abc"), 1s);
  EXPECT_EQ(clock->now(), 0ms) << "as a port of the system's: the writer goes on at once";
  EXPECT_EQ(link->read(100, 1s), bytes("a"));
  EXPECT_EQ(clock->now(), (1ms + 2ms) + 3ms + (1ms + 2ms)) << "there, its answer, and back";
  clock->sleep_for(10ms);
  EXPECT_EQ(link->read(1, 1s), bytes("b"));  // at most what was asked for
  EXPECT_EQ(link->read(100, 1s), bytes("c"));
}

// Full duplex: "b" goes out while the answer to "a" comes in, and neither waits.
TEST_F(MemoryByteLink, EachByteArrivesAtItsOwnTimeBothWaysAtOnce) {
  EchoPeer peer;
  const auto link = link_to(peer, {0s, 1ms});
  link->write(bytes("ab"), 1s);
  clock->sleep_until(1500us);
  EXPECT_EQ(peer.heard, bytes("a"));
  EXPECT_EQ(link->read(2, 1s), bytes("a"));
  EXPECT_EQ(clock->now(), 2ms);
  EXPECT_EQ(link->read(2, 1s), bytes("b"));
  EXPECT_EQ(clock->now(), 3ms);
}

// No call of the driver is needed for it, and another link's bytes go on meanwhile.
TEST_F(MemoryByteLink, DeliversWhileTheWriterDoesSomethingElse) {
  EchoPeer first, second;
  const auto one = link_to(first, {0s, 1ms}), other = link_to(second, {0s, 1ms});
  one->write(bytes("abc"), 1s);
  other->write(bytes("abc"), 1s);
  clock->sleep_until(3ms + 1us);
  EXPECT_EQ(first.heard, bytes("abc"));
  EXPECT_EQ(second.heard, bytes("abc"));
}

TEST_F(MemoryByteLink, SendsWhatItWasGivenBeforeItIsClosed) {
  EchoPeer peer;
  auto link = link_to(peer, {0s, 1ms});
  link->write(bytes("off"), 1s);
  link.reset();
  EXPECT_EQ(peer.heard, bytes("off"));
  EXPECT_EQ(clock->now(), 3ms);
}

TEST_F(MemoryByteLink, ReturnsNothingAtTheDeadline) {
  EchoPeer peer(3s);
  const auto link = link_to(peer);
  link->write(bytes("abc"), 1s);
  EXPECT_EQ(link->read(100, 2s), ByteString{});
  EXPECT_EQ(clock->now(), 2s);
  EXPECT_EQ(link->read(100, 2s), bytes("abc"));
  EXPECT_EQ(clock->now(), 3s);
}

// Of 5000 bytes a buffer of 4096 takes the first at once, and one more with each that has left.
TEST_F(MemoryByteLink, GivesUpWritingWhereTheWireIsTooSlow) {
  EchoPeer peer;
  const auto link = link_to(peer, {0s, 1ms});
  EXPECT_EQ(kind_of([&] { link->write(ByteString(5000), 50ms); }), DeviceErrorKind::timeout);
  EXPECT_EQ(clock->now(), 50ms);
}

TEST_F(MemoryByteLink, IsHeardByAReaderThatAlreadyWaits) {
  EchoPeer peer;
  const auto link = link_to(peer);
  const auto writer = clock->spawn("writer", [&] {
    clock->sleep_for(100ms);
    link->write(bytes("x"), 1s);
  });
  EXPECT_EQ(link->read(100, 1s), bytes("x"));
  EXPECT_EQ(clock->now(), 100ms);
}

TEST_F(MemoryByteLink, DeliversWhatATaskThatIsStoppedWasWriting) {
  EchoPeer peer;
  const auto link = link_to(peer, {10ms, 0s});
  const auto writer = clock->spawn("writer", [&] { link->write(bytes("stop"), 1s); });
  clock->sleep_for(5ms);
  writer->request_stop();
  writer->join();
  clock->sleep_for(10ms);
  EXPECT_EQ(peer.heard, bytes("stop"));
}

TEST_F(MemoryByteLink, IsLostWithinHalfASecondOfBeingUnplugged) {
  EchoPeer peer;
  const auto link = link_to(peer);
  const auto hand = clock->spawn("hand", [&] {
    clock->sleep_for(1s);
    faults.unplugged = true;
  });
  EXPECT_EQ(kind_of([&] { link->read(1, 100s); }), DeviceErrorKind::lost);
  EXPECT_LE(clock->now(), 1500ms);
  EXPECT_EQ(kind_of([&] { link->write(bytes("x"), 1s); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { link->reopen(); }), DeviceErrorKind::lost);
  faults.unplugged = false;
  link->reopen();
  link->write(bytes("y"), 1s);
  EXPECT_EQ(link->read(10, 1s), bytes("y"));
}

TEST_F(MemoryByteLink, ForgetsWhatWasOnItsWayWhenItIsReopened) {
  EchoPeer peer;
  const auto link = link_to(peer, {10ms, 0s});
  link->write(bytes("old"), 1s);
  link->reopen();
  EXPECT_EQ(link->read(10, 1s), ByteString{});
}

TEST_F(MemoryByteLink, CanBeDeafOrSilent) {
  EchoPeer peer;
  const auto link = link_to(peer);
  faults.deaf = true;
  link->write(bytes("a"), 1s);
  EXPECT_TRUE(peer.heard.empty());
  faults = {.silent = true};
  link->write(bytes("b"), 1s);
  EXPECT_EQ(peer.heard, bytes("b"));
  EXPECT_EQ(all(*link), ByteString{});
}

TEST_F(MemoryByteLink, CanBeLate) {
  EchoPeer peer;
  const auto link = link_to(peer);
  faults.late = 400ms;
  link->write(bytes("a"), 1s);
  EXPECT_EQ(link->read(1, 300ms), ByteString{});
  EXPECT_EQ(link->read(1, 300ms), bytes("a"));
  EXPECT_EQ(clock->now(), 400ms);
}

TEST_F(MemoryByteLink, CanCutAReplyShortAndGarbleAByte) {
  EchoPeer peer;
  const auto link = link_to(peer);
  faults.keep = 2;
  link->write(bytes("abc"), 1s);
  EXPECT_EQ(all(*link), bytes("ab"));
  faults = {.garble = 1, .flip = 0x20};
  link->write(bytes("abc"), 1s);
  EXPECT_EQ(all(*link), bytes("aBc"));
  link->write(bytes("abc"), 1s);
  EXPECT_EQ(all(*link), bytes("abc"));  // one byte only
}

TEST_F(MemoryByteLink, ThrowsForATimeThatRunsBackwards) {
  EchoPeer peer;
  EXPECT_THROW(link_to(peer, {-1ms, 0s}), std::invalid_argument);
  EXPECT_THROW(link_to(peer, {0s, -1ms}), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
