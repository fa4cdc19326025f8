// Links of messages and Modbus against servers by another hand (tests/doubles/). On the wall clock,
// over real lines.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/address.h"
#include "devices/links/modbus.h"
#include "devices/links/usbtmc_link.h"
#include "devices/time/error.h"
#include "tests/devices/doubles/double_process.h"
#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Options = std::vector<std::string>;
using Words = std::vector<std::uint16_t>;

std::string text(const std::optional<ByteString>& message) {
  return message ? std::string(message->begin(), message->end()) : "nothing";
}
std::string ask(MessageLink& link, const std::string& question, Time timeout = 2s) {
  link.write(bytes(question), 1s);
  return text(link.read(10000, timeout));
}
DeviceErrorKind kind_of(const std::function<void()>& work, std::string* what = nullptr) {
  try {
    work();
  } catch (const DeviceError& error) {
    if (what != nullptr) *what = error.what();
    return error.kind;
  }
  ADD_FAILURE() << "no error";
  return DeviceErrorKind::protocol;
}
/// "core=127.0.0.1:4321 abort=...": the port behind a name.
std::string port_of(const std::string& line, const std::string& name) {
  const std::size_t at = line.find(name + "=");
  const std::size_t colon = line.find(':', at);
  return line.substr(colon + 1, line.find(' ', colon) - colon - 1);
}
constexpr const char* kIdentity = "VITREO DOUBLES,SUPPLY 30-5,0,1.0\n";

/// A supply by each of the two protocols of a network.
struct Lan {
  const char* bus;
  const char* device;
  Options extra;
};
class LanSupply : public testing::TestWithParam<Lan> {
 protected:
  std::unique_ptr<MessageLink> open(const std::string& device = "") {
    const bool vxi = std::string(GetParam().bus) == "vxi11";
    return open_message_link(std::string(GetParam().bus) +
                                 ":127.0.0.1:" + (device.empty() ? GetParam().device : device) +
                                 "@" + port_of(supply.address(), vxi ? "core" : "hislip"),
                             *clock);
  }
  static DoubleProcess start(const Lan& how) {
    // Not strict: its own buffer for input takes more than the message of many parts.
    Options words{"scpi_supply", "--option", "strict=false", std::string("--") + how.bus, "0"};
    if (std::string(how.bus) == "vxi11") words.insert(words.end(), {"--portmap", "0"});
    words.insert(words.end(), how.extra.begin(), how.extra.end());
    return DoubleProcess::of_server("lan_serve.py", words);
  }
  const std::unique_ptr<Clock> clock = wall_clock();
  DoubleProcess supply = start(GetParam());
};
INSTANTIATE_TEST_SUITE_P(Ways, LanSupply,
                         testing::Values(Lan{"vxi11", "inst0", {}}, Lan{"hislip", "hislip0", {}},
                                         Lan{"hislip", "hislip0", {"--chatty"}}),
                         [](const auto& made) {
                           return std::string(made.param.bus) +
                                  (made.param.extra.empty() ? "" : "_chatty");
                         });

TEST_P(LanSupply, AnswersAndObeys) {
  const auto link = open();
  EXPECT_EQ(ask(*link, "*IDN?\n"), kIdentity);
  link->write(bytes("VOLT 12.5\n"), 1s);
  EXPECT_EQ(std::stod(ask(*link, "VOLT?\n")), 12.5);
  EXPECT_EQ(supply.number("voltage_set"), 12.5);
  for (int i = 0; i < 50; ++i) ASSERT_EQ(ask(*link, "*IDN?\n"), kIdentity);
}

TEST_P(LanSupply, TakesAMessageOfManyParts) {
  const auto link = open();
  std::string many;
  while (many.size() < 5000) many += "VOLT 3;";
  link->write(bytes(many + "VOLT 7\n"), 2s);
  EXPECT_EQ(std::stod(ask(*link, "VOLT?\n")), 7);
}

TEST_P(LanSupply, IsClearedAfterAnAnswerThatDidNotCome) {
  const auto link = open();
  const Time before = clock->now();
  EXPECT_EQ(ask(*link, "VOLT 1\n", 300ms), "nothing");
  EXPECT_GE(clock->now() - before, 300ms);
  EXPECT_LT(clock->now() - before, 1500ms);
  link->clear(2s);
  EXPECT_EQ(ask(*link, "*IDN?\n"), kIdentity);
}

// A measurement takes 20 ms; its answer is not read, and not taken for the next one.
TEST_P(LanSupply, AnAnswerThatWasNotReadIsNotTheNextOne) {
  const auto link = open();
  link->write(bytes("MEAS:VOLT?\n"), 1s);
  clock->sleep_for(100ms);
  link->clear(2s);
  EXPECT_EQ(ask(*link, "*IDN?\n"), kIdentity);
}

TEST_P(LanSupply, HasOneOwner) {
  const auto link = open();
  std::string what;
  EXPECT_EQ(kind_of([&] { open(); }, &what), DeviceErrorKind::refused);
  EXPECT_NE(what.find("another program has it open"), std::string::npos) << what;
  EXPECT_EQ(ask(*link, "*IDN?\n"), kIdentity);
}

TEST_P(LanSupply, TellsADeviceThatItDoesNotHave) {
  EXPECT_EQ(kind_of([&] { open("nothing7"); }), DeviceErrorKind::not_found);
}

TEST_P(LanSupply, IsLostWhenItIsUnpluggedAndComesBack) {
  const auto link = open();
  supply.order(R"({"unplug": true})");
  clock->sleep_for(50ms);
  EXPECT_EQ(kind_of([&] { ask(*link, "*IDN?\n"); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { link->reopen(); }), DeviceErrorKind::not_found);
  supply.order(R"({"plug": true})");
  link->reopen();
  EXPECT_EQ(ask(*link, "*IDN?\n"), kIdentity);
}

class UdpSupply : public testing::TestWithParam<Options> {};
INSTANTIATE_TEST_SUITE_P(Ways, UdpSupply,
                         testing::Values(Options{}, Options{"--option", "twice=2"}),
                         [](const auto& made) { return made.param.empty() ? "plain" : "twice"; });
TEST_P(UdpSupply, AnswersAndObeys) {
  const auto clock = wall_clock();
  Options words{"scpi_supply", "--option", "wire=udp", "--udp", "0"};
  words.insert(words.end(), GetParam().begin(), GetParam().end());
  DoubleProcess supply = DoubleProcess::of_server("serve.py", words);
  const auto link = open_message_link("udp:" + supply.address(), *clock);
  for (int i = 0; i < 10; ++i) {
    link->clear(1s);
    ASSERT_EQ(ask(*link, "*IDN?"), kIdentity);
  }
  clock->sleep_for(50ms);
  link->clear(1s);
  EXPECT_EQ(ask(*link, "VOLT 3", 100ms), "nothing");
  EXPECT_EQ(supply.number("voltage_set"), 3);
}

/// The oven on both wires.
class Controller : public testing::TestWithParam<Options> {
 protected:
  bool tcp() const { return GetParam().front() == "wire=tcp"; }
  bool echoes() const { return GetParam().back() == "chatty=true" && !tcp(); }
  DoubleProcess start() const {
    if (!tcp()) return DoubleProcess("temperature_controller", GetParam());
    Options words{"temperature_controller", "--tcp", "0"};
    for (const std::string& option : GetParam()) words.insert(words.end(), {"--option", option});
    return DoubleProcess::of_server("serve.py", words);
  }
  std::unique_ptr<modbus::Client> open(Time reply_timeout = 500ms) {
    modbus::Settings settings;
    settings.name = "oven";
    settings.framing = tcp() ? modbus::Framing::tcp : modbus::Framing::rtu;
    settings.reply_timeout = reply_timeout;
    settings.character = tcp() ? Time() : character_time(SerialSettings{});
    settings.echo = echoes();
    return modbus::make_client(open_byte_link((tcp() ? "tcp:" : "") + oven.address(), {}, *clock),
                               settings, *clock);
  }
  const std::unique_ptr<Clock> clock = wall_clock();
  DoubleProcess oven = start();
};
INSTANTIATE_TEST_SUITE_P(Ways, Controller,
                         testing::Values(Options{"wire=rtu"}, Options{"wire=rtu", "chatty=true"},
                                         Options{"wire=tcp"}, Options{"wire=tcp", "chatty=true"}),
                         [](const auto& made) {
                           return made.param.front().substr(5) +
                                  (made.param.size() > 1 ? "_chatty" : "");
                         });

// HCP TC038D: the temperature is two words at 0, the set-point two at 0x106, in tenths.
TEST_P(Controller, IsReadAndSet) {
  const auto client = open();
  EXPECT_EQ(client->read_holding_registers(1, 0, 2), (Words{0, 220}));
  client->write_registers(1, 0x106, Words{0, 451});
  EXPECT_EQ(client->read_holding_registers(1, 0x106, 2), (Words{0, 451}));
  EXPECT_NEAR(oven.number("setpoint"), 45.1, 1e-9);
  EXPECT_EQ(client->ask(1, ByteString{8, 0, 0, 0x12, 0x34}), (ByteString{8, 0, 0, 0x12, 0x34}));
}

TEST_P(Controller, RefusesByTheNameOfTheException) {
  const auto client = open();
  std::string what;
  EXPECT_EQ(kind_of([&] { client->read_coils(1, 0, 1); }, &what), DeviceErrorKind::refused);
  EXPECT_NE(what.find("illegal function (exception 1)"), std::string::npos) << what;
  EXPECT_EQ(kind_of([&] { client->read_holding_registers(1, 0x4000, 2); }),
            DeviceErrorKind::refused);
  EXPECT_EQ(client->read_holding_registers(1, 0, 2), (Words{0, 220}));
}

TEST_P(Controller, ALateAnswerIsNotTheNextOne) {
  oven.order(R"({"set": {"heating": false}})");
  const auto client = open(150ms);
  client->write_registers(1, 0x106, Words{0, 300});
  oven.order(R"({"mode": {"work": 0.4}})");
  EXPECT_EQ(kind_of([&] { client->read_holding_registers(1, 0x106, 2); }),
            DeviceErrorKind::timeout);
  oven.order(R"({"mode": {"work": 0.002}})");
  if (tcp()) clock->sleep_for(400ms);  // one frame after another: it is busy until then
  EXPECT_EQ(client->read_holding_registers(1, 0, 2), (Words{0, 220}));
}

TEST_P(Controller, IsLostWhenItIsUnpluggedAndComesBack) {
  const auto client = open();
  oven.order(R"({"unplug": true})");
  clock->sleep_for(50ms);
  EXPECT_EQ(kind_of([&] { client->read_holding_registers(1, 0, 2); }), DeviceErrorKind::lost);
}

// Its two bulk pipes and its requests by another hand; the host's end is ours.
TEST(Teslameter, AnswersByUsbtmc) {
  const auto clock = wall_clock();
  for (const Options& options : {Options{}, Options{"pieces=7"}}) {
    DoubleProcess probe = DoubleProcess::on_socket("metrolab_thm1176", options);
    const auto link = usbtmc_link(open_double_usbtmc(probe.address(), *clock), *clock);
    EXPECT_EQ(ask(*link, "*IDN?"), "Metrolab Technology SA,THM1176-MF,0000803,elD1-prD0-fw3.1\n");
    probe.order(R"({"set": {"field": [0.01, 0, -0.02]}})");
    link->write(bytes(":SENS:AUTO OFF;:SENS 0.1 T;:AVER:COUN 10;:UNIT T;:INIT"), 1s);
    const std::string field = ask(*link, ":FETC:X? 5;:FETC:Z? 5");
    EXPECT_NEAR(std::stod(field), 0.01, 1e-3) << field;
    EXPECT_NEAR(std::stod(field.substr(field.find(';') + 1)), -0.02, 1e-3) << field;
    // A question, a read that comes to nothing, and the next question ends it.
    link->write(bytes("*CLS"), 1s);
    EXPECT_EQ(text(link->read(99, 200ms)), "nothing");
    EXPECT_EQ(ask(*link, "*OPC?"), "1\n");
    link->write(bytes("*IDN?"), 1s);
    link->clear(1s);
    EXPECT_EQ(ask(*link, "*OPC?"), "1\n");
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
