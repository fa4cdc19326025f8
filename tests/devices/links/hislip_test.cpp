// HiSLIP against a stand-in from the standard's words, on the virtual clock: numbers of messages,
// late answers, device clear, locks, errors.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/hislip_link.h"
#include "devices/links/hislip_messages.h"
#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <deque>
#include <functional>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using hislip::Message;
using hislip::Type;

struct Failure {
  DeviceErrorKind kind = DeviceErrorKind::not_found;
  std::string text;
};
Failure failure_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.device, "hislip:10.0.0.7");
    return {error.kind, error.text};
  }
  ADD_FAILURE() << "no error";
  return {};
}

// IVI-6.1, table 3: "HS", type, control code, parameter, length of the payload, big-endian.
TEST(HislipMessages, HaveTheHeaderOfTheStandard) {
  const ByteString sent = hislip::to_bytes({Type::data_end, 1, 0xFFFFFF00, bytes("*RST")});
  EXPECT_EQ(sent, (ByteString{'H', 'S', 7, 1, 0xFF, 0xFF, 0xFF, 0,   0,   0,
                              0,   0,   0, 0, 0,    4,    '*',  'R', 'S', 'T'}));
  ByteString stream(sent.begin(), sent.end() - 1);
  EXPECT_FALSE(hislip::take_message(stream));
  stream.push_back('T');
  stream.push_back('H');
  const auto read = hislip::take_message(stream);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->type, Type::data_end);
  EXPECT_EQ(read->parameter, 0xFFFFFF00U);
  EXPECT_EQ(read->payload, bytes("*RST"));
  EXPECT_EQ(stream, bytes("H"));
  ByteString junk = bytes("GET /");
  EXPECT_THROW(hislip::take_message(junk), std::invalid_argument);
  ByteString huge{'H', 'S', 7, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0};
  EXPECT_THROW(hislip::take_message(huge), std::invalid_argument);
}

/// An instrument that echoes whole messages.
struct Instrument {
  Time delay{};
  bool overlapped = false;
  bool locked_by_other = false;
  bool knows_locks = true;
  bool renumbers = false;        // its answers carry the number of another message
  std::uint64_t maximum = 1024;  // what it takes at most
  std::size_t part = 1 << 20;    // what it sends at once
  std::vector<Message> heard;    // Data and DataEnd
  ByteString coming;
  int clears = 0;
};

class Side final : public BytePeer {
 public:
  explicit Side(Instrument& its) : its_(its) {}
  void receive(std::span<const std::uint8_t> come, Time now) override {
    stream_.insert(stream_.end(), come.begin(), come.end());
    while (const auto message = hislip::take_message(stream_)) answer(*message, now);
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> now_said;
    for (; !said.empty() && said.front().at <= now; said.pop_front())
      now_said.push_back(said.front());
    return now_said;
  }
  Time next() const override { return said.empty() ? kForever : said.front().at; }
  void put(const Message& message, Time at) { said.push_back({at, hislip::to_bytes(message)}); }
  std::deque<TimedBytes> said;

 private:
  void answer(const Message& message, Time now) {
    const auto mode = static_cast<std::uint8_t>(its_.overlapped ? 1 : 0);
    switch (message.type) {
      case Type::initialize:
        EXPECT_EQ(message.parameter >> 16, 0x0100U);
        if (message.payload != bytes("hislip0"))
          return put({Type::fatal_error, 3, 0, bytes("no such sub-address")}, now);
        return put({Type::initialize_response, mode, 0x01000005}, now);
      case Type::async_initialize:
        EXPECT_EQ(message.parameter, 5U) << "the session's number";
        return put({Type::async_initialize_response}, now);
      case Type::async_maximum_message_size:
        EXPECT_EQ(message.payload.size(), 8U);
        return put(
            {Type::async_maximum_message_size_response, 0, 0, hislip::size_payload(its_.maximum)},
            now);
      case Type::async_lock:
        return put(
            {Type::async_lock_response, static_cast<std::uint8_t>(!its_.knows_locks      ? 3
                                                                  : its_.locked_by_other ? 0
                                                                                         : 1)},
            now);
      case Type::data:
      case Type::data_end:
        return take(message, now);
      case Type::async_device_clear:
        ++its_.clears;
        return put({Type::async_device_clear_acknowledge, mode}, now);
      case Type::device_clear_complete:
        its_.coming.clear();
        return put({Type::device_clear_acknowledge, mode}, now);
      default:
        ADD_FAILURE() << "type " << static_cast<int>(message.type);
    }
  }
  void take(const Message& message, Time now) {
    EXPECT_LE(message.payload.size(), its_.maximum);
    its_.heard.push_back(message);
    its_.coming.insert(its_.coming.end(), message.payload.begin(), message.payload.end());
    if (message.type == Type::data) return;
    const std::uint32_t number = its_.renumbers ? message.parameter - 2 : message.parameter;
    std::span<const std::uint8_t> left(its_.coming);
    do {
      const auto part = left.first(std::min(left.size(), its_.part));
      left = left.subspan(part.size());
      put({left.empty() ? Type::data_end : Type::data, 0, number, {part.begin(), part.end()}},
          later(now, its_.delay));
    } while (!left.empty());
    its_.coming.clear();
  }

  Instrument& its_;
  ByteString stream_;
};

struct HislipTest : ::testing::Test {
  std::unique_ptr<MessageLink> open(const std::string& device = "hislip0") {
    sides.clear();
    return open_hislip_on(
        "hislip:10.0.0.7", {"10.0.0.7", device, 0},
        [this] {
          sides.push_back(std::make_unique<Side>(instrument));
          return memory_byte_link(*sides.back(), *clock, {}, &faults);
        },
        *clock);
  }
  Side& sync() { return *sides.at(sides.size() - 2); }
  Side& async() { return *sides.back(); }
  std::unique_ptr<Clock> clock = virtual_clock();
  LinkFaults faults;
  Instrument instrument;
  std::vector<std::unique_ptr<Side>> sides;
};

TEST_F(HislipTest, CarriesMessagesWholeInPartsEitherWay) {
  instrument.part = 700;
  const auto link = open();
  EXPECT_EQ(link->description(), "hislip:10.0.0.7");
  ByteString large(5000);
  for (std::size_t i = 0; i < large.size(); ++i) large[i] = static_cast<std::uint8_t>(i * 7);
  for (const ByteString& one : {bytes("*IDN?\n"), large, ByteString{}}) {
    link->write(one, 1s);
    EXPECT_EQ(link->read(10000, 1s), one);
  }
  EXPECT_EQ(clock->now(), 0s);
}

// 3.1.2: from 0xFFFFFF00 in steps of 2; RMT-delivered with the first message after an answer.
TEST_F(HislipTest, NumbersItsMessagesAndTellsWhatItTook) {
  const auto link = open();
  link->write(bytes("a"), 1s);
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("b?")) << "the answer to a is dropped by its number";
  link->write(bytes("c"), 1s);
  ASSERT_EQ(instrument.heard.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(instrument.heard[i].parameter, 0xFFFFFF00U + 2 * i);
  EXPECT_EQ(instrument.heard[1].control, 0);
  EXPECT_EQ(instrument.heard[2].control, 1);
}

TEST_F(HislipTest, NeverTakesALateAnswerForTheNextOne) {
  instrument.delay = 500ms;
  const auto link = open();
  link->write(bytes("a?"), 1s);
  EXPECT_EQ(link->read(9, 100ms), std::nullopt);
  EXPECT_EQ(clock->now(), 100ms);
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(link->read(9, 2s), bytes("b?"));
  EXPECT_EQ(clock->now(), 600ms);
}

TEST_F(HislipTest, ServersInOverlappedModeCountTheirOwnMessages) {
  instrument.overlapped = instrument.renumbers = true;
  const auto link = open();
  link->write(bytes("a?"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("a?"));
  instrument.overlapped = false;
  link->clear(1s);
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(link->read(9, 1s), std::nullopt) << "of a synchronized one the number would be wrong";
}

TEST_F(HislipTest, ClearsTheDeviceAndBeginsToCountAnew) {
  instrument.delay = 100ms;
  const auto link = open();
  link->write(bytes("a?"), 1s);
  clock->sleep_for(200ms);  // its answer has come
  link->clear(1s);
  EXPECT_EQ(instrument.clears, 1);
  EXPECT_EQ(link->read(9, 1s), std::nullopt);
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(instrument.heard.back().parameter, 0xFFFFFF00U);
  EXPECT_EQ(link->read(9, 1s), bytes("b?"));
}

TEST_F(HislipTest, HasOneOwnerWhereTheInstrumentKnowsLocks) {
  instrument.locked_by_other = true;
  const Failure owned = failure_of([&] { open(); });
  EXPECT_EQ(owned.kind, DeviceErrorKind::refused);
  EXPECT_EQ(owned.text, "another program has it open");
  instrument.knows_locks = false;
  EXPECT_EQ(open()->description(), "hislip:10.0.0.7 (which knows no locks)");
}

TEST_F(HislipTest, AnUnknownSubAddressIsNotFound) {
  const Failure found = failure_of([&] { open("hislip9"); });
  EXPECT_EQ(found.kind, DeviceErrorKind::not_found);
  EXPECT_EQ(found.text, "it ends the connection with the fatal error 3: no such sub-address");
}

TEST_F(HislipTest, AnErrorIsAnAnswerAndAFatalOneTheEnd) {
  const auto link = open();
  sync().put({Type::error, 1, 0, bytes("unrecognized")}, clock->now());
  const Failure refused = failure_of([&] { link->read(9, 1s); });
  EXPECT_EQ(refused.kind, DeviceErrorKind::refused);
  EXPECT_EQ(refused.text, "it answers with the error 1: unrecognized");
  link->write(bytes("a?"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("a?"));
  async().put({Type::fatal_error, 1, 0, bytes("poorly formed header")}, clock->now());
  EXPECT_EQ(failure_of([&] { link->read(9, 1s); }).kind, DeviceErrorKind::lost);
  EXPECT_EQ(failure_of([&] { link->write(bytes("b"), 1s); }).text, "it is closed");
  link->reopen();
  link->write(bytes("c?"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("c?"));
}

TEST_F(HislipTest, PassesOverServiceRequestsAndInterruptions) {
  const auto link = open();
  async().put({Type::async_service_request, 0x40}, clock->now());
  async().put({Type::async_interrupted, 0, 0xFFFFFF00}, clock->now());
  link->write(bytes("a?"), 1s);
  sync().put({Type::interrupted, 0, 0xFFFFFF00}, clock->now());
  EXPECT_EQ(link->read(9, 1s), bytes("a?"));
}

TEST_F(HislipTest, DropsAMessageThatIsTooLong) {
  instrument.part = 10;
  const auto link = open();
  link->write(ByteString(100, 'x'), 1s);
  const Failure found = failure_of([&] { link->read(50, 1s); });
  EXPECT_EQ(found.kind, DeviceErrorKind::protocol);
  EXPECT_EQ(found.text, "a message of 100 bytes, more than 50");
  link->write(bytes("b"), 1s);
  EXPECT_EQ(link->read(50, 1s), bytes("b"));
}

TEST_F(HislipTest, JunkIsToldAndEndsTheConnection) {
  const auto link = open();
  sync().said.push_back({clock->now(), bytes("HTTP/1.1 400")});
  const Failure found = failure_of([&] { link->read(9, 1s); });
  EXPECT_EQ(found.kind, DeviceErrorKind::protocol);
  EXPECT_EQ(found.text, "emulated: what came is no message of HiSLIP: it does not begin with HS");
  EXPECT_EQ(failure_of([&] { link->read(9, 1s); }).kind, DeviceErrorKind::lost);
}

TEST_F(HislipTest, IsLostWithItsConnectionsAndComesBack) {
  const auto link = open();
  faults.unplugged = true;
  EXPECT_EQ(failure_of([&] { link->read(9, 1s); }).kind, DeviceErrorKind::lost);
  EXPECT_EQ(failure_of([&] { link->reopen(); }).kind, DeviceErrorKind::lost);
  faults.unplugged = false;
  link->reopen();
  link->write(bytes("a"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("a"));
}

TEST_F(HislipTest, AServerThatSaysNothingIsATimeout) {
  faults.silent = true;
  const Failure found = failure_of([&] { open(); });
  EXPECT_EQ(found.kind, DeviceErrorKind::timeout);
  EXPECT_EQ(found.text, "it does not answer in time");
  EXPECT_EQ(clock->now(), 2s);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
