// Messages of instruments that do not answer, answer late, or are others than they should be: they
// name the line and say what its bytes look like.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/driver.h"
#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/scpi_probe/driver.h"
#include "devices/instruments/scpi_probe/emulator.h"
#include "devices/instruments/sutter_mp285/driver.h"
#include "devices/instruments/sutter_mp285/emulator.h"
#include "devices/instruments/sutter_mpc200/driver.h"
#include "devices/instruments/zaber/driver.h"
#include "devices/instruments/zaber/emulator.h"
#include "devices/links/serial_link.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/echo_peer.h"

#include <algorithm>
#include <array>
#include <map>
#include <utility>

namespace vitreo {
namespace VITREO_TEST_FILE {

/// Of which half a second is silence, and not the five that a real one may take.
sutter_mp285::Settings quick() {
  sutter_mp285::Settings settings;
  settings.reply_timeout = 0.5;
  return settings;
}

using namespace std::chrono_literals;

/// A link in memory under the name of a port.
class NamedLink final : public ByteLink {
 public:
  NamedLink(std::unique_ptr<ByteLink> link, std::string address, std::string settings)
      : link_(std::move(link)), address_(std::move(address)), settings_(std::move(settings)) {}
  const std::string& address() const override { return address_; }
  std::string description() const override { return address_ + settings_; }
  void write(std::span<const std::uint8_t> bytes, Time timeout) override {
    link_->write(bytes, timeout);
  }
  ByteString read(std::size_t most, Time timeout) override { return link_->read(most, timeout); }
  void reopen() override { link_->reopen(); }

 private:
  std::unique_ptr<ByteLink> link_;
  const std::string address_, settings_;
};

constexpr const char* kPort = "serial:/dev/ttyUSB0 at 9600 baud, 8N1";

struct Silence : SerialBench {
  std::unique_ptr<ByteLink> port_to(BytePeer& peer) {
    return std::make_unique<NamedLink>(link_to(peer), "serial:/dev/ttyUSB0",
                                       " at " + to_string(SerialSettings{}));
  }
  /// The whole message of the error of `work`.
  static std::string message_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      return error.what();
    }
    return "no error";
  }
  static bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  }
  /// Each driver of a byte link, opened with `peer` at the far end: the message by driver.
  std::map<std::string, std::string> messages_of(BytePeer& peer) {
    std::map<std::string, std::string> said;
    said["sutter_mp285"] = message_of([&] { sutter_mp285::open(port_to(peer), quick(), *clock); });
    said["sutter_mpc200"] = message_of([&] { sutter_mpc200::open(port_to(peer), {}, *clock); });
    said["zaber"] = message_of([&] { zaber::open(port_to(peer), {}, *clock); });
    said["scpi_probe"] = message_of([&] { scpi_probe::open(port_to(peer), probe(), *clock); });
    said["kepco_bop"] = message_of([&] {
      std::vector<std::unique_ptr<ByteLink>> links;
      links.push_back(port_to(peer));
      kepco_bop::open(std::move(links), {}, *clock);
    });
    return said;
  }
  static scpi_probe::Settings probe() {
    scpi_probe::Settings settings;
    settings.question = "MEAS?";
    return settings;
  }
};

TEST_F(Silence, NamesTheLineTheQuestionAndWhatMayBeWrong) {
  const auto emulator = sutter_mp285::make_emulator();
  faults.silent = true;
  EXPECT_EQ(message_of([&] { sutter_mp285::open(port_to(*emulator), quick(), *clock); }),
            std::string("stage: ") + kPort +
                " says nothing to \"set velocity\" within 0.5 s: is it on, is this its cable, is "
                "the rate right? (timeout)");
}

TEST_F(Silence, IsNamedByEveryDriverOfAByteLink) {
  Stranger mute("");
  for (const auto& [driver, said] : messages_of(mute)) {
    EXPECT_TRUE(has(said, std::string(kPort) + " says nothing to \"")) << driver << ": " << said;
    EXPECT_TRUE(has(said, "is it on, is this its cable, is the rate right?")) << said;
    EXPECT_FALSE(has(said, "\n")) << said;
  }
}

// The second that an answer has, less what clearing and sending took.
TEST_F(Silence, OfATcpLinkDoesNotAskForARate) {
  Stranger mute("");
  const auto link = [&] {
    return std::make_unique<NamedLink>(link_to(mute), "tcp:10.0.0.7:5025", "");
  };
  EXPECT_EQ(
      message_of([&] { scpi_probe::open(link(), probe(), *clock); }),
      "field_probe: tcp:10.0.0.7:5025 says nothing to \"*IDN?\" within 0.97 s: the connection "
      "stands, so is this its address and port? (timeout)");
}

TEST_F(Silence, OfAnEmulatedInstrumentAsksForNoCable) {
  Stranger mute("");
  EXPECT_EQ(message_of([&] { scpi_probe::open(link_to(mute), probe(), *clock); }),
            "field_probe: emulated says nothing to \"*IDN?\" within 0.97 s (timeout)");
}

TEST_F(Silence, InARunNamesTheLineToo) {
  const auto emulator = sutter_mp285::make_emulator();
  const auto stage = sutter_mp285::open(port_to(*emulator), quick(), *clock);
  faults.silent = true;
  EXPECT_EQ(
      message_of([&] { stage->position(); }),
      std::string("stage: ") + kPort + " says nothing to \"get position\" within 0.5 s (timeout)");
}

TEST_F(Silence, IsToldFromALateAnswer) {
  const auto emulator = sutter_mp285::make_emulator();
  faults.late = 1300ms;
  const std::string said =
      message_of([&] { sutter_mp285::open(port_to(*emulator), quick(), *clock); });
  EXPECT_TRUE(has(said,
                  "says nothing to \"set velocity\" within 0.5 s; \"\\x0D\" came within 1.3 s "
                  "of \"set velocity\", and not within 0.5 s: is it slow?"))
      << said;
  EXPECT_FALSE(has(said, "is it on")) << said;
}

TEST_F(Silence, OfASlowZaberSaysThatItAnswersEarlierCommands) {
  const auto emulator = zaber::make_emulator({{.address = 1, .axes = {{}}}});
  faults.late = 700ms;
  const std::string said = message_of([&] { zaber::open(port_to(*emulator), {}, *clock); });
  EXPECT_TRUE(has(said, "it answers earlier commands only: is it slow?")) << said;
}

TEST_F(Silence, OfTheSecondDeviceOfAChainBlamesNeitherCableNorRate) {
  const auto emulator = zaber::make_emulator({{.address = 1, .axes = {{}}}});
  zaber::Settings two;
  two.axes = {{.name = "x", .device = 1}, {.name = "y", .device = 2}};
  const std::string said = message_of([&] { zaber::open(port_to(*emulator), two, *clock); });
  EXPECT_TRUE(has(said, "stage: device 2: ")) << said;
  EXPECT_TRUE(has(said, "says nothing to \"get version\"")) << said;
  EXPECT_FALSE(has(said, "cable")) << said;
}

// One wrong, one too slow, one dead read alike before.
TEST_F(Silence, ALineThatEchoesIsCalledOneByEveryDriver) {
  EchoPeer echo;
  for (const auto& [driver, said] : messages_of(echo)) {
    EXPECT_TRUE(has(said,
                    "the line echoes what is sent: a loop-back plug, an RS-485 adapter with "
                    "echo, or an instrument in terminal mode"))
        << driver << ": " << said;
    EXPECT_TRUE(has(said, kPort)) << said;
  }
}

/// An instrument in terminal mode: each line, and then its answer.
struct Terminal final : BytePeer {
  explicit Terminal(BytePeer& its) : peer(its) {}
  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    for (const std::uint8_t byte : bytes)
      if (byte >= 0x20 || byte == '\n') echo.push_back({now, {byte}});
    peer.receive(bytes, now);
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> all = std::exchange(echo, {});
    for (TimedBytes& one : peer.say(now)) all.push_back(std::move(one));
    return all;
  }
  Time next() const override { return echo.empty() ? peer.next() : echo.front().at; }
  BytePeer& peer;
  std::vector<TimedBytes> echo;
};

TEST_F(Silence, AnInstrumentInTerminalModeIsAnEchoToo) {
  const auto emulator = scpi_probe::make_emulator({.question = "MEAS?"}, [](Time) {
    return std::vector<double>{0, 0, 0};
  });
  Terminal terminal(*emulator);
  const std::string said =
      message_of([&] { scpi_probe::open(port_to(terminal), probe(), *clock); });
  EXPECT_TRUE(has(said, "the line echoes what is sent")) << said;
}

TEST_F(Silence, SwappedCablesAreToldByWhatTheOtherInstrumentAnswers) {
  Stranger zaber("@01 0 RJ IDLE -- BADCOMMAND\r\n");
  Stranger supply("KEPCO,BOP 36-12MG,A123456,1.74\r\n");
  Stranger mp285("4\r");
  for (const auto& [driver, said] : messages_of(zaber))
    if (driver != "zaber") {
      EXPECT_TRUE(has(said, "looks like a Zaber device")) << driver << ": " << said;
    }
  for (const auto& [driver, said] : messages_of(supply))
    if (driver.starts_with("sutter") || driver == "zaber") {
      EXPECT_TRUE(has(said, "looks like the SCPI instrument KEPCO BOP 36-12MG")) << said;
    }
  for (const auto& [driver, said] : messages_of(mp285))
    if (driver != "sutter_mp285") {
      EXPECT_TRUE(has(said, "looks like a Sutter MP-285")) << driver << ": " << said;
    }
}

TEST_F(Silence, AnswersThatAreLikeNothingKnownAreShown) {
  Stranger noise("\xF8\xFE\r\n");
  for (const auto& [driver, said] : messages_of(noise)) {
    EXPECT_TRUE(has(said, "\\xF8")) << driver << ": " << said;
    EXPECT_TRUE(has(said, "is this its cable, is the rate right?")) << driver << ": " << said;
  }
}

TEST_F(Silence, TheRoleIsNamedOnceAndTheKindOnce) {
  for (const char* answer : {"V\r", "V\r\n", "\xF8", "4\r", "@01 0 RJ IDLE -- NO\r\n"}) {
    Stranger stranger(answer);
    for (const auto& [driver, said] : messages_of(stranger)) {
      const std::string role = said.substr(0, said.find(": "));
      EXPECT_FALSE(has(said.substr(role.size()), role + ": ")) << driver << ": " << said;
      EXPECT_EQ(std::count(said.begin(), said.end(), '('), 1) << driver << ": " << said;
    }
  }
}

struct EightSupplies : Silence {
  EightSupplies() {
    name = "coils";
    for (int i = 0; i < 8; ++i) {
      emulators.push_back(kepco_bop::make_emulator({.network = true}, [](Time, double) {}));
      listeners.push_back(std::make_unique<Listener>(*emulators.back()));
    }
  }
  std::unique_ptr<CoilAmplifier> open_all() {
    std::vector<std::unique_ptr<ByteLink>> links;
    for (std::size_t i = 0; i < 8; ++i)
      links.push_back(
          std::make_unique<NamedLink>(memory_byte_link(*listeners[i], *clock, {}, &cables[i]),
                                      "tcp:10.0.0." + std::to_string(11 + i) + ":5025", ""));
    return kepco_bop::open(std::move(links), {}, *clock);
  }
  std::vector<std::unique_ptr<kepco_bop::Emulator>> emulators;
  std::vector<std::unique_ptr<Listener>> listeners;
  std::array<LinkFaults, 8> cables;
};

TEST_F(EightSupplies, TheSilentOneIsNamedAndTheOthersHaveTheirZero) {
  cables[3].silent = true;
  EXPECT_EQ(message_of([&] { open_all(); }),
            "coils: channel 4: tcp:10.0.0.14:5025 says nothing to \"*IDN?\" within 0.5 s: the "
            "connection stands, so is this its address and port? no zero was sent to it, so a "
            "current that was set before may still flow; every other channel has confirmed its "
            "zero (timeout)");
  EXPECT_EQ(listeners[3]->count("CURR"), 0) << "it is not known what is there";
  EXPECT_EQ(listeners[7]->count("CURR 0"), 3) << "two when it is opened, one when that is given up";
  for (const auto& emulator : emulators) EXPECT_FALSE(emulator->output());
}

TEST_F(EightSupplies, EachIsTriedWhateverBecameOfTheOthers) {
  cables[1].silent = cables[5].silent = true;
  const std::string said = message_of([&] { open_all(); });
  EXPECT_TRUE(has(said, "coils: channel 2: ")) << said;
  EXPECT_TRUE(has(said, "nor is the zero of channel 6 confirmed; every other one is")) << said;
}

TEST_F(EightSupplies, AZeroThatWasSentAndNotConfirmedIsNotClaimed) {
  // The answers to ESC and to *IDN?, then nothing more.
  cables[2].keep = static_cast<int>(std::string("\r\nKEPCO,BOP 36-12MG,A123456,1.74\r\n").size());
  const std::string said = message_of([&] { open_all(); });
  EXPECT_TRUE(has(said, "coils: channel 3: tcp:10.0.0.13:5025 says nothing to \"*CLS;:SYST:REM"))
      << said;
  EXPECT_TRUE(has(said, "its zero was tried and is not confirmed, so a current may still flow"))
      << said;
}

TEST_F(EightSupplies, EveryErrorOfARunNamesItsChannel) {
  const auto coils = open_all();
  const std::vector<double> some(8, 1.);
  cables[4].silent = true;
  EXPECT_TRUE(has(message_of([&] { coils->set_currents(some); }),
                  "coils: channel 5: tcp:10.0.0.15:5025 says nothing to \"CURR 1"));
  EXPECT_TRUE(has(message_of([&] { coils->measured_currents(); }), "coils: channel 5: "));
  EXPECT_TRUE(has(message_of([&] { coils->make_safe(); }), "coils: channel 5: "));
  cables[4] = {.unplugged = true};
  EXPECT_EQ(message_of([&] { coils->set_currents(some); }),
            "coils: channel 5: emulated: is gone (lost)");
  EXPECT_EQ(message_of([&] { coils->set_currents(some); }),
            "coils: channel 5: tcp:10.0.0.15:5025 was lost (lost)");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
