// Modbus: the frames of the standard, the client's errors and times, and late answers.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/modbus.h"

#include "devices/links/modbus_emulator.h"
#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <deque>
#include <functional>
#include <map>
#include <stdexcept>

namespace vitreo::modbus {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Words = std::vector<std::uint16_t>;
using Bits = std::vector<bool>;

std::string failure_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const DeviceError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no error";
  return "";
}
DeviceErrorKind kind_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const DeviceError& error) {
    return error.kind;
  }
  ADD_FAILURE() << "no error";
  return DeviceErrorKind::not_found;
}

// The examples of Modbus Application Protocol 1.1b3, chapters 6.1, 6.3, 6.5, 6.6, 6.11 and 6.12.
TEST(ModbusFrames, AreThoseOfTheStandardsExamples) {
  EXPECT_EQ(read_request(Function::read_coils, 19, 19), (ByteString{1, 0, 0x13, 0, 0x13}));
  EXPECT_EQ(read_request(Function::read_holding_registers, 107, 3), (ByteString{3, 0, 0x6B, 0, 3}));
  EXPECT_EQ(write_coil_request(172, true), (ByteString{5, 0, 0xAC, 0xFF, 0}));
  EXPECT_EQ(write_register_request(1, 3), (ByteString{6, 0, 1, 0, 3}));
  EXPECT_EQ(write_coils_request(19, {1, 0, 1, 1, 0, 0, 1, 1, 1, 0}),
            (ByteString{15, 0, 0x13, 0, 0x0A, 2, 0xCD, 0x01}));
  EXPECT_EQ(write_registers_request(1, Words{0x000A, 0x0102}),
            (ByteString{16, 0, 1, 0, 2, 4, 0, 0x0A, 1, 2}));
  EXPECT_EQ(unpack_bits(ByteString{0xCD, 0x6B, 0x05}, 19),
            (Bits{1, 0, 1, 1, 0, 0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 0, 1}));
}

// Modbus over Serial Line 1.02, 6.2.2: of the bytes 02 07 the CRC is 1241 hexadecimal.
TEST(ModbusFrames, EndWithTheCrcOfTheStandardsExample) {
  EXPECT_EQ(crc16(ByteString{0x02, 0x07}), 0x1241);
  EXPECT_EQ(rtu_frame(2, ByteString{7}), (ByteString{0x02, 0x07, 0x41, 0x12}));
  EXPECT_TRUE(has_right_crc(ByteString{0x02, 0x07, 0x41, 0x12}));
  EXPECT_FALSE(has_right_crc(ByteString{0x02, 0x07, 0x41, 0x13}));
  EXPECT_FALSE(has_right_crc(ByteString{0x02}));
}

// Messaging on TCP/IP 1.0b, 4.3.1.
TEST(ModbusFrames, HaveAHeaderOnTcp) {
  const ByteString frame =
      tcp_frame(0x1501, 0xFF, read_request(Function::read_holding_registers, 4, 1));
  EXPECT_EQ(frame, (ByteString{0x15, 0x01, 0, 0, 0, 6, 0xFF, 3, 0, 4, 0, 1}));
  const auto header = parse_mbap(frame);
  ASSERT_TRUE(header);
  EXPECT_EQ(header->transaction, 0x1501);
  EXPECT_EQ(header->unit, 0xFF);
  EXPECT_EQ(header->pdu_size, 5U);
  EXPECT_FALSE(parse_mbap(ByteString{0, 1, 0, 1, 0, 6, 1})) << "another protocol";
  EXPECT_FALSE(parse_mbap(ByteString{0, 1, 0, 0, 0, 1, 1})) << "no function";
  EXPECT_FALSE(parse_mbap(ByteString{0, 1, 0, 0, 1, 0, 1})) << "too long";
}

TEST(ModbusFrames, RefuseWhatTheStandardDoesNotAllow) {
  for (const auto& [function, most] :
       std::map<Function, int>{{Function::read_coils, 2000},
                               {Function::read_discrete_inputs, 2000},
                               {Function::read_input_registers, 125},
                               {Function::read_holding_registers, 125}}) {
    EXPECT_NO_THROW(read_request(function, 0, most));
    EXPECT_THROW(read_request(function, 0, most + 1), std::invalid_argument);
    EXPECT_THROW(read_request(function, 0, 0), std::invalid_argument);
    EXPECT_NO_THROW(read_request(function, 65536 - most, most));
    EXPECT_THROW(read_request(function, 65537 - most, most), std::invalid_argument);
    EXPECT_THROW(read_request(function, -1, 1), std::invalid_argument);
  }
  EXPECT_NO_THROW(write_registers_request(0, Words(123)));
  EXPECT_THROW(write_registers_request(0, Words(124)), std::invalid_argument);
  EXPECT_NO_THROW(write_coils_request(0, Bits(1968)));
  EXPECT_THROW(write_coils_request(0, Bits(1969)), std::invalid_argument);
}

/// Registers and coils in maps; input tables mirror those that can be written.
struct Maps final : Store {
  std::optional<std::uint16_t> read(Table table, std::uint16_t address, Time) override {
    const auto& own = of(table);
    const auto found = own.find(address);
    return found == own.end() ? std::nullopt : std::optional(found->second);
  }
  std::uint8_t write(Table table, std::uint16_t address, std::uint16_t value, Time) override {
    if (of(table).count(address) == 0) return 2;
    if (value == 0xDEAD) return 3;
    of(table)[address] = value;
    return 0;
  }
  std::map<std::uint16_t, std::uint16_t>& of(Table table) {
    return table == Table::coils || table == Table::discrete_inputs ? bits : words;
  }
  std::map<std::uint16_t, std::uint16_t> bits{{0, 0}, {1, 1}, {2, 0}};
  std::map<std::uint16_t, std::uint16_t> words{{0x0106, 250}, {0x0107, 1}, {0x0108, 65535}};
};

struct ModbusTest : ::testing::TestWithParam<Framing> {
  std::unique_ptr<Client> client_on(BytePeer& peer, Settings settings = {}) {
    settings.framing = GetParam();
    settings.name = "oven";
    settings.character = GetParam() == Framing::rtu ? 1ms : 0ms;
    return make_client(memory_byte_link(peer, *clock, {0ms, settings.character}, &faults), settings,
                       *clock);
  }
  std::unique_ptr<BytePeer> emulator(Time delay = 2ms) {
    return make_emulator(store, {.framing = GetParam(),
                                 .unit = 1,
                                 .delay = delay,
                                 .character = GetParam() == Framing::rtu ? Time(1ms) : Time()});
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  LinkFaults faults;
  Maps store;
};
INSTANTIATE_TEST_SUITE_P(OverBothFramings, ModbusTest,
                         ::testing::Values(Framing::rtu, Framing::tcp));

TEST_P(ModbusTest, ReadsAndWritesEveryTable) {
  const auto peer = emulator();
  const auto client = client_on(*peer);
  EXPECT_EQ(client->read_holding_registers(1, 0x0106, 3), (Words{250, 1, 65535}));
  client->write_register(1, 0x0106, 300);
  client->write_registers(1, 0x0107, Words{7, 8});
  EXPECT_EQ(client->read_input_registers(1, 0x0106, 3), (Words{300, 7, 8}));
  client->write_coil(1, 0, true);
  client->write_coils(1, 1, {false, true});
  EXPECT_EQ(client->read_coils(1, 0, 3), (Bits{true, false, true}));
  EXPECT_EQ(client->read_discrete_inputs(1, 2, 1), (Bits{true}));
}

TEST_P(ModbusTest, NamesTheExceptionAndTheQuestion) {
  const auto peer = emulator();
  const auto client = client_on(*peer);
  EXPECT_EQ(
      failure_of([&] { client->read_holding_registers(1, 0x0107, 3); }),
      "oven: to \"read holding registers 263 to 265 of unit 1\" it says: illegal data address "
      "(exception 2) (refused)");
  EXPECT_EQ(failure_of([&] { client->write_register(1, 0x0106, 0xDEAD); }),
            "oven: to \"write register 262 of unit 1\" it says: illegal data value (exception 3) "
            "(refused)");
  EXPECT_EQ(failure_of([&] {
              client->ask(1, ByteString{0x2B, 14, 1, 0});
            }),
            "oven: to \"function 43 of unit 1\" it says: illegal function (exception 1) (refused)");
  EXPECT_EQ(client->read_holding_registers(1, 0x0106, 1), Words{250}) << "and goes on";
}

TEST_P(ModbusTest, SendsNothingThatCannotBe) {
  const auto peer = emulator();
  const auto client = client_on(*peer);
  EXPECT_EQ(failure_of([&] { client->read_holding_registers(1, 0, 126); }),
            "oven: count: must be 1 to 125, not 126 (out of range)");
  EXPECT_EQ(kind_of([&] { client->write_register(1, 65536, 0); }), DeviceErrorKind::out_of_range);
  EXPECT_EQ(clock->now(), 0s);
}

// The oldest trap of the protocol: after a time-out the answers are shifted by one, for ever.
TEST_P(ModbusTest, NeverTakesALateAnswerForTheNextOne) {
  const auto peer = emulator();
  const auto client = client_on(*peer, {.reply_timeout = 400ms, .late = 1s});
  faults.late = 500ms;
  EXPECT_EQ(kind_of([&] { client->read_holding_registers(1, 0x0106, 1); }),
            DeviceErrorKind::timeout);
  faults.late = 0s;
  EXPECT_EQ(client->read_holding_registers(1, 0x0108, 1), Words{65535});
  EXPECT_EQ(client->read_holding_registers(1, 0x0107, 1), Words{1});
}

TEST_P(ModbusTest, SaysThatNothingCameAndGoesOn) {
  const auto peer = emulator();
  const auto client = client_on(*peer, {.reply_timeout = 200ms, .late = 300ms});
  faults.deaf = true;
  EXPECT_EQ(failure_of([&] { client->read_holding_registers(1, 0x0106, 1); }),
            "oven: emulated says nothing to \"read holding registers 262 of unit 1\" within " +
                std::string(GetParam() == Framing::rtu ? "0.21" : "0.2") + " s (timeout)");
  faults.deaf = false;
  EXPECT_EQ(client->read_holding_registers(1, 0x0106, 1), Words{250});
}

TEST_P(ModbusTest, TellsACutAnswer) {
  const auto peer = emulator();
  const auto client = client_on(*peer, {.reply_timeout = 200ms, .late = 300ms});
  faults.keep = 4;
  const std::string what = failure_of([&] { client->read_holding_registers(1, 0x0106, 1); });
  EXPECT_NE(what.find("only 4 of 7 bytes of an answer came in time"), std::string::npos) << what;
  faults.keep = -1;
  if (GetParam() == Framing::rtu) {
    EXPECT_EQ(client->read_holding_registers(1, 0x0106, 1), Words{250});
  } else {  // TCP loses no bytes: the stream is out of step, and that is told
    const std::string next = failure_of([&] { client->read_holding_registers(1, 0x0106, 1); });
    EXPECT_FALSE(next.empty());
  }
}

TEST_P(ModbusTest, AStopWaitsForTheEndOfTheExchange) {
  const auto peer = emulator(50ms);
  const auto client = client_on(*peer);
  const auto task = clock->spawn("task", [&] { client->read_holding_registers(1, 0x0106, 1); });
  clock->sleep_for(10ms);
  task->request_stop();
  task->join();
  EXPECT_EQ(client->read_holding_registers(1, 0x0108, 1), Words{65535});
}

TEST_P(ModbusTest, IsLostAndComesBack) {
  const auto peer = emulator();
  const auto client = client_on(*peer);
  faults.unplugged = true;
  EXPECT_EQ(kind_of([&] { client->read_holding_registers(1, 0x0106, 1); }), DeviceErrorKind::lost);
  EXPECT_TRUE(client->lost());
  faults.unplugged = false;
  EXPECT_EQ(kind_of([&] { client->read_holding_registers(1, 0x0106, 1); }), DeviceErrorKind::lost);
  client->reopen();
  EXPECT_EQ(client->read_holding_registers(1, 0x0106, 1), Words{250});
}

/// Answers each message with the next of a list, whatever it asks.
struct Scripted final : BytePeer {
  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    heard.insert(heard.end(), bytes.begin(), bytes.end());
    if (heard.size() < size) return;
    heard.erase(heard.begin(), heard.begin() + static_cast<std::ptrdiff_t>(size));
    at.push_back(now);
    if (answers.empty()) return;
    for (auto& [delay, answer] : answers.front()) said.push_back({now + delay, answer});
    answers.pop_front();
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> now_said;
    for (; !said.empty() && said.front().at <= now; said.pop_front())
      now_said.push_back(said.front());
    return now_said;
  }
  Time next() const override { return said.empty() ? kForever : said.front().at; }
  std::deque<std::vector<std::pair<Time, ByteString>>> answers;
  std::size_t size = 8;  // of a question
  ByteString heard;
  std::vector<Time> at;  // when each question was over
  std::deque<TimedBytes> said;
};

struct ModbusLine : ::testing::Test {
  std::unique_ptr<Client> client(const Settings& settings = {.name = "oven", .character = 1ms}) {
    return make_client(memory_byte_link(peer, *clock, {0ms, settings.character}), settings, *clock);
  }
  ByteString good(std::uint16_t value, std::uint8_t unit = 1) {
    ByteString pdu{3, 2};
    put_word(pdu, value);
    return rtu_frame(unit, pdu);
  }
  ModbusLine() { clock->sleep_until(kStart); }  // the line has been silent until then
  static constexpr Time kStart = 1s;
  std::unique_ptr<Clock> clock = virtual_clock();
  Scripted peer;
};

TEST_F(ModbusLine, LeavesThreeAndAHalfCharactersBetweenFrames) {
  peer.answers = {{{2ms, good(1)}}, {{2ms, good(2)}}};
  const auto line = client();
  EXPECT_EQ(line->read_holding_registers(1, 0, 1), Words{1});
  const Time over = clock->now();
  EXPECT_EQ(over, kStart + 8ms + 2ms + 7ms);
  EXPECT_EQ(line->read_holding_registers(1, 0, 1), Words{2});
  EXPECT_EQ(peer.at.at(1) - over, 3500us + 8ms);
}

// MSL 2.5.1.1: above 19200 baud 1.75 ms at any rate.
TEST_F(ModbusLine, TheSilenceIsNeverShorterThanTheStandards) {
  peer.answers = {{{2ms, good(1)}}, {{2ms, good(2)}}};
  const auto line = client({.name = "oven", .character = 100us});
  line->read_holding_registers(1, 0, 1);
  const Time over = clock->now();
  line->read_holding_registers(1, 0, 1);
  EXPECT_EQ(peer.at.at(1) - over, 1750us + 800us);
}

TEST_F(ModbusLine, TellsAWrongCrcAndGoesOnAtOnce) {
  ByteString bad = good(1);
  bad[4] ^= 1;
  peer.answers = {{{2ms, bad}}, {{2ms, good(2)}}};
  const auto line = client();
  const std::string what = failure_of([&] { line->read_holding_registers(1, 0, 1); });
  EXPECT_NE(what.find("it answers with a wrong CRC"), std::string::npos) << what;
  EXPECT_EQ(line->read_holding_registers(1, 0, 1), Words{2});
  EXPECT_LT(clock->now(), kStart + 200ms);
}

TEST_F(ModbusLine, PassesOverTheAnswersOfOthers) {
  peer.answers = {{{2ms, good(7, 9)}, {60ms, good(1)}}, {{2ms, good(7, 9)}}};
  const auto line = client();
  EXPECT_EQ(line->read_holding_registers(1, 0, 1), Words{1});
  const std::string what = failure_of([&] { line->read_holding_registers(1, 0, 1); });
  EXPECT_NE(what.find("came only what is no answer"), std::string::npos) << what;
  EXPECT_NE(what.find("(timeout)"), std::string::npos) << what;
}

TEST_F(ModbusLine, PassesOverJunkBeforeAnAnswer) {
  peer.answers = {{{1ms, {0xFF, 0x00, 0x55}}, {60ms, good(1)}}};
  EXPECT_EQ(client()->read_holding_registers(1, 0, 1), Words{1});
}

// A driver of RS-485 that turns: a byte of noise, and the answer at once.
TEST_F(ModbusLine, FindsAnAnswerBehindNoise) {
  ByteString noisy{0x00, 0xFF};
  const ByteString answer = good(5);
  noisy.insert(noisy.end(), answer.begin(), answer.end());
  peer.answers = {{{2ms, noisy}}};
  EXPECT_EQ(client()->read_holding_registers(1, 0, 1), Words{5});
  EXPECT_LT(clock->now(), kStart + 30ms);
}

TEST_F(ModbusLine, TakesAwayTheEchoOfAnAdapterThatHearsItself) {
  const ByteString asked = rtu_frame(1, read_request(Function::read_holding_registers, 0, 1));
  const ByteString written = rtu_frame(1, write_register_request(1, 3));
  peer.answers = {{{0ms, asked}, {2ms, good(5)}},
                  {{0ms, written}, {2ms, rtu_frame(1, ByteString{0x86, 2})}},
                  {{0ms, asked}},
                  {{0ms, good(1)}}};
  const auto line = client({.name = "oven", .late = 0s, .character = 1ms, .echo = true});
  EXPECT_EQ(line->read_holding_registers(1, 0, 1), Words{5});
  EXPECT_EQ(kind_of([&] { line->write_register(1, 1, 3); }), DeviceErrorKind::refused)
      << "the echo of a write is not its answer";
  EXPECT_EQ(kind_of([&] { line->read_holding_registers(1, 0, 1); }), DeviceErrorKind::timeout);
  EXPECT_EQ(kind_of([&] { line->read_holding_registers(1, 0, 1); }), DeviceErrorKind::timeout)
      << "seven bytes are not the eight that were sent";
}

TEST_F(ModbusLine, SaysThatTheLineGivesBackWhatIsSent) {
  peer.answers = {{{0ms, rtu_frame(1, read_request(Function::read_holding_registers, 0, 1))}}};
  const std::string what = failure_of([&] { client()->read_holding_registers(1, 0, 1); });
  EXPECT_NE(what.find("the line gives back what is sent: is `echo` to be set?"), std::string::npos)
      << what;
}

TEST_F(ModbusLine, TellsAnAnswerOfAnotherLength) {
  ByteString pdu{3, 4, 0, 1, 0, 2};
  peer.answers = {{{2ms, rtu_frame(1, pdu)}}};
  const std::string what = failure_of([&] { client()->read_holding_registers(1, 0, 1); });
  EXPECT_NE(what.find("it answers 5 bytes in place of 3"), std::string::npos) << what;
}

TEST_F(ModbusLine, TellsAWriteThatWasAnsweredOfSomethingElse) {
  peer.answers = {{{2ms, rtu_frame(1, ByteString{6, 0, 1, 0, 4})}}};
  EXPECT_EQ(kind_of([&] { client()->write_register(1, 1, 3); }), DeviceErrorKind::protocol);
}

TEST_F(ModbusLine, ABroadcastIsNotAnsweredAndTakesItsTurnaround) {
  const auto line = client();
  line->write_register(0, 1, 3);
  EXPECT_EQ(clock->now(), kStart + 8ms + 100ms);
  EXPECT_EQ(kind_of([&] { line->read_holding_registers(0, 0, 1); }), DeviceErrorKind::out_of_range);
}

TEST_F(ModbusLine, AGatewayWhoseTargetIsSilentIsATimeout) {
  peer.answers = {{{2ms, rtu_frame(1, ByteString{0x83, 11})}}};
  EXPECT_EQ(failure_of([&] { client()->read_holding_registers(1, 0, 1); }),
            "oven: to \"read holding registers 0 of unit 1\" it says: gateway target device failed "
            "to respond (exception 11) (timeout)");
}

// A late answer that comes later than Settings::late cannot be told: of the same question it is the
// same frame. Until then the next question waits.
TEST_F(ModbusLine, TheNextQuestionWaitsForTheLateAnswerAndNoLonger) {
  peer.answers = {{{1300ms, good(1)}}, {{2ms, good(2)}}, {}, {{2ms, good(3)}}};
  const auto line = client({.name = "oven", .reply_timeout = 1s, .late = 1s, .character = 1ms});
  EXPECT_EQ(kind_of([&] { line->read_holding_registers(1, 0, 1); }), DeviceErrorKind::timeout);
  EXPECT_EQ(clock->now(), kStart + 8ms + 1s);
  EXPECT_EQ(line->read_holding_registers(1, 0, 1), Words{2});
  EXPECT_LT(clock->now(), kStart + 8ms + 1300ms + 100ms)
      << "it had come, so nothing more is waited for";
  EXPECT_EQ(kind_of([&] { line->read_holding_registers(1, 0, 1); }), DeviceErrorKind::timeout);
  const Time silent = clock->now();
  EXPECT_EQ(line->read_holding_registers(1, 0, 1), Words{3});
  EXPECT_GE(clock->now() - silent, 1s);
}

TEST(ModbusTcp, GivesTheConnectionUpWhereJunkComes) {
  const auto clock = virtual_clock();
  Scripted peer;
  peer.size = 12;
  peer.answers = {{{1ms, bytes("HTTP/1.1 400 Bad Request")}}};
  const auto client = make_client(memory_byte_link(peer, *clock),
                                  {.name = "oven", .framing = Framing::tcp}, *clock);
  const std::string what = failure_of([&] { client->read_coils(1, 0, 1); });
  EXPECT_NE(what.find("came what is no Modbus"), std::string::npos) << what;
  EXPECT_TRUE(client->lost());
}

TEST(ModbusSettings, AreChecked) {
  const auto clock = virtual_clock();
  Scripted peer;
  const auto make = [&](const Settings& settings) {
    return make_client(memory_byte_link(peer, *clock), settings, *clock);
  };
  EXPECT_THROW(make({.reply_timeout = 0s}), std::invalid_argument);
  EXPECT_THROW(make({.late = -1s}), std::invalid_argument);
  EXPECT_THROW(make_client(nullptr, {}, *clock), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::modbus
