// The message link in memory, its faults and its tap; and UDP on this machine.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/message_link.h"

#include "devices/links/address.h"
#include "devices/links/link_tap.h"
#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/devices/links/message_echo.h"

#include <gtest/gtest.h>

#include <arpa/inet.h>
#include <functional>
#include <netinet/in.h>
#include <numeric>
#include <stdexcept>
#include <sys/socket.h>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct Failure {
  DeviceErrorKind kind = DeviceErrorKind::not_found;
  std::string text;
};
Failure failure_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const DeviceError& error) {
    return {error.kind, error.what()};
  }
  ADD_FAILURE() << "no error";
  return {};
}

struct MemoryMessageLink : ::testing::Test {
  std::unique_ptr<MessageLink> link_to(MessageEcho& peer, Time latency = {}) {
    return memory_message_link(peer, *clock, latency, &faults);
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  LinkFaults faults;
};

TEST_F(MemoryMessageLink, KeepsTheBoundariesOfMessages) {
  MessageEcho peer;
  const auto link = link_to(peer);
  ByteString every(256);
  std::iota(every.begin(), every.end(), std::uint8_t{0});
  for (const ByteString& one : {every, ByteString{}, bytes("b")}) link->write(one, 1s);
  EXPECT_EQ(link->read(1000, 1s), every);
  EXPECT_EQ(link->read(1000, 1s), ByteString{}) << "an empty message is one too";
  EXPECT_EQ(link->read(1000, 1s), bytes("b"));
  EXPECT_EQ(clock->now(), 0s);
  EXPECT_EQ(link->read(1000, 1s), std::nullopt);
  EXPECT_EQ(clock->now(), 1s);
}

TEST_F(MemoryMessageLink, TakesTheTimeOfTheWireEachWay) {
  MessageEcho peer(3ms);
  const auto link = link_to(peer, 2ms);
  link->write(bytes("a"), 1s);
  EXPECT_EQ(clock->now(), 2ms) << "the instrument has acknowledged it";
  EXPECT_EQ(link->read(9, 4999us), std::nullopt);
  EXPECT_EQ(link->read(9, 1s), bytes("a"));
  EXPECT_EQ(clock->now(), 7ms);
}

TEST_F(MemoryMessageLink, ClearingDropsWhatIsOnItsWayAndWhatWasAboutToBeSaid) {
  MessageEcho peer(5ms);
  const auto link = link_to(peer, 1ms);
  link->write(bytes("a"), 1s);
  clock->sleep_for(5ms);  // "a" is on its way back
  link->write(bytes("b"), 1s);
  link->clear(1s);
  EXPECT_EQ(link->read(9, 1s), std::nullopt);
  link->write(bytes("c"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("c"));
}

TEST_F(MemoryMessageLink, HasTheFaultsOfALink) {
  MessageEcho peer;
  const auto link = link_to(peer);
  faults = {.deaf = true};
  link->write(bytes("a"), 1s);
  faults = {.silent = true};
  link->write(bytes("b"), 1s);
  EXPECT_EQ(link->read(9, 1s), std::nullopt);
  EXPECT_EQ(peer.heard.size(), 1U);
  faults = {.keep = 2};
  link->write(bytes("abc"), 1s);
  link->write(bytes("def"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("ab"));
  EXPECT_EQ(link->read(9, 1s), bytes("de")) << "of each message";
  faults = {.garble = 1, .flip = 1};
  link->write(bytes("abc"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("acc"));
  faults = {.late = 2s};
  const Time sent = clock->now();
  link->write(bytes("a"), 1s);
  EXPECT_EQ(link->read(9, 1s), std::nullopt);
  EXPECT_EQ(link->read(9, 2s), bytes("a"));
  EXPECT_EQ(clock->now() - sent, 2s);
}

TEST_F(MemoryMessageLink, EndsAWaitWhenItsCableIsPulled) {
  MessageEcho peer;
  const auto link = link_to(peer);
  const auto hand = clock->spawn("hand", [&] {
    clock->sleep_for(20ms);
    faults.unplugged = true;
  });
  const Failure lost = failure_of([&] { link->read(9, 5s); });
  EXPECT_EQ(lost.kind, DeviceErrorKind::lost);
  EXPECT_LE(clock->now(), 500ms);
  EXPECT_EQ(failure_of([&] { link->reopen(); }).kind, DeviceErrorKind::lost);
  faults.unplugged = false;
  link->reopen();
  link->write(bytes("a"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("a"));
}

TEST_F(MemoryMessageLink, DropsAMessageThatIsTooLong) {
  MessageEcho peer;
  const auto link = link_to(peer);
  link->write(bytes("abcd"), 1s);
  link->write(bytes("ef"), 1s);
  const Failure found = failure_of([&] { link->read(3, 1s); });
  EXPECT_EQ(found.kind, DeviceErrorKind::protocol);
  EXPECT_EQ(found.text, "emulated: a message of 4 bytes, more than 3 (protocol)");
  EXPECT_EQ(link->read(3, 1s), bytes("ef"));
}

TEST_F(MemoryMessageLink, AStopComesOnceTheMessageIsOnItsWay) {
  MessageEcho peer;
  const auto link = link_to(peer, 1ms);
  const auto task = clock->spawn("task", [&] { link->write(bytes("off"), 1s); });
  clock->sleep_for(0s);
  task->request_stop();
  task->join();
  EXPECT_EQ(peer.heard, std::vector<ByteString>{bytes("off")});
}

TEST_F(MemoryMessageLink, IsSeenByATap) {
  struct Tape final : LinkTap {
    void passed(const LinkName& link, Time, LinkEvent event,
                std::span<const std::uint8_t> some) override {
      all +=
          link.role + " " + to_string(event) + " " + std::string(some.begin(), some.end()) + "\n";
    }
    std::string all;
  } tape;
  MessageEcho peer;
  const auto link = tapped(link_to(peer), {"probe", "emulated"}, tape, *clock);
  link->write(bytes("abc"), 1s);
  link->read(9, 1s);
  link->read(9, 1s);  // nothing came: nothing is noted
  link->clear(1s);
  faults.unplugged = true;
  failure_of([&] { link->read(9, 1s); });
  EXPECT_EQ(tape.all,
            "probe opened \nprobe to abc\nprobe from abc\nprobe cleared \n"
            "probe failed emulated: is gone (lost)\n");
}

TEST_F(MemoryMessageLink, RefusesALatencyBelowZero) {
  MessageEcho peer;
  EXPECT_THROW(memory_message_link(peer, *clock, -1ns), std::invalid_argument);
}

/// A socket of an instrument on this machine.
struct Datagrams {
  Datagrams() {
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof here;
    EXPECT_EQ(::bind(handle, reinterpret_cast<sockaddr*>(&here), size), 0);
    EXPECT_EQ(::getsockname(handle, reinterpret_cast<sockaddr*>(&here), &size), 0);
    port = ntohs(here.sin_port);
  }
  ~Datagrams() { ::close(handle); }
  Datagrams(const Datagrams&) = delete;
  Datagrams& operator=(const Datagrams&) = delete;
  std::string address() const { return "udp:127.0.0.1:" + std::to_string(port); }
  ByteString take() {
    ByteString got(70000);
    socklen_t size = sizeof from;
    const ssize_t count = ::recvfrom(handle, got.data(), got.size(), MSG_DONTWAIT,
                                     reinterpret_cast<sockaddr*>(&from), &size);
    EXPECT_GE(count, 0);
    got.resize(static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
    return got;
  }
  void say(const ByteString& datagram) {
    EXPECT_EQ(::sendto(handle, datagram.data(), datagram.size(), 0,
                       reinterpret_cast<sockaddr*>(&from), sizeof from),
              static_cast<ssize_t>(datagram.size()));
  }
  const int handle = ::socket(AF_INET, SOCK_DGRAM, 0);
  int port = 0;
  sockaddr_in from{};
};

struct UdpLinkTest : ::testing::Test {
  std::unique_ptr<MessageLink> open(const std::string& address) {
    return open_message_link(address, *clock);
  }
  std::unique_ptr<Clock> clock = virtual_clock(Pace::real_time);
};

TEST_F(UdpLinkTest, CarriesDatagramsWholeEitherWay) {
  Datagrams instrument;
  const auto link = open(instrument.address());
  EXPECT_EQ(link->address(), instrument.address());
  const ByteString large(60000, 0xA5);
  for (const ByteString& one : {bytes("*IDN?\n"), ByteString{}, large}) {
    link->write(one, 1s);
    EXPECT_EQ(instrument.take(), one);
    instrument.say(one);
  }
  EXPECT_EQ(link->read(70000, 1s), bytes("*IDN?\n"));
  EXPECT_EQ(link->read(70000, 1s), ByteString{});
  EXPECT_EQ(link->read(70000, 1s), large);
  const Time before = clock->now();
  EXPECT_EQ(link->read(9, 30ms), std::nullopt);
  EXPECT_GE(clock->now() - before, 30ms);
}

TEST_F(UdpLinkTest, TakesNoDatagramsOfOthers) {
  Datagrams instrument, stranger;
  const auto link = open(instrument.address());
  link->write(bytes("a"), 1s);
  instrument.take();
  stranger.from = instrument.from;
  stranger.say(bytes("junk"));
  instrument.say(bytes("b"));
  EXPECT_EQ(link->read(9, 1s), bytes("b"));
}

TEST_F(UdpLinkTest, TellsOversizeBothWays) {
  Datagrams instrument;
  const auto link = open(instrument.address());
  const Failure out = failure_of([&] { link->write(ByteString(65508), 1s); });
  EXPECT_EQ(out.kind, DeviceErrorKind::out_of_range);
  EXPECT_EQ(out.text, instrument.address() +
                          ": a datagram has at most 65507 bytes, not 65508 (out of range)");
  link->write(bytes("a"), 1s);
  instrument.take();
  instrument.say(bytes("toolong"));
  instrument.say(bytes("b"));
  const Failure in = failure_of([&] { link->read(6, 1s); });
  EXPECT_EQ(in.kind, DeviceErrorKind::protocol);
  EXPECT_NE(in.text.find(instrument.address() + ": a message of 7 bytes"), std::string::npos);
  EXPECT_EQ(link->read(6, 1s), bytes("b"));
}

TEST_F(UdpLinkTest, ClearingDropsWhatCame) {
  Datagrams instrument;
  const auto link = open(instrument.address());
  link->write(bytes("a"), 1s);
  instrument.take();
  for (int i = 0; i < 20; ++i) instrument.say(bytes("late"));
  link->clear(1s);
  instrument.say(bytes("b"));
  EXPECT_EQ(link->read(9, 1s), bytes("b"));
}

TEST_F(UdpLinkTest, IsLostWhereNothingListensAndComesBack) {
  auto instrument = std::make_unique<Datagrams>();
  const std::string address = instrument->address();
  const auto link = open(address);
  instrument.reset();
  link->write(bytes("a"), 1s);
  const Failure lost = failure_of([&] { link->read(9, 1s); });
  EXPECT_EQ(lost.kind, DeviceErrorKind::lost);
  EXPECT_EQ(lost.text, address + ": nothing listens at this port: Connection refused (lost)");
  EXPECT_EQ(failure_of([&] { link->write(bytes("a"), 1s); }).kind, DeviceErrorKind::lost);
  link->reopen();
  link->write(bytes("a"), 1s);
}

TEST_F(UdpLinkTest, AddressesThatAreNoneAreNamed) {
  for (const char* bad : {"udp:host", "udp:host:0", "udp::80", "tcp:host:80", "serial:/dev/x", ""})
    EXPECT_THROW(open(bad), std::invalid_argument) << bad;
  EXPECT_TRUE(carries_messages("udp:host:1"));
  EXPECT_FALSE(carries_messages("tcp:host:1"));
  EXPECT_EQ(failure_of([&] { open("udp:no-such-host.invalid:80"); }).kind,
            DeviceErrorKind::not_found);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
