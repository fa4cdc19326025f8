// Questions to a port of which nothing is known: each emulator is recognized and stands still, and
// silence, an echo, a wrong rate and a stranger are called what they are.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/asking.h"

#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/scpi_probe/emulator.h"
#include "devices/instruments/sutter_mp285/emulator.h"
#include "devices/instruments/sutter_mp285/wire.h"
#include "devices/instruments/sutter_mpc200/emulator.h"
#include "devices/instruments/zaber/emulator.h"
#include "devices/scripted/emulator.h"
#include "devices/time/error.h"
#include "host/rig/instrument_file.h"
#include "host/rig/plugged_in.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Names = std::vector<std::string>;

/// One bit of a line at rest, or of the bytes that go over it: 8N1, the least significant bit
/// first.
std::vector<bool> line_of(const ByteString& bytes) {
  std::vector<bool> bits(20, true);
  for (const std::uint8_t byte : bytes) {
    bits.push_back(false);
    for (unsigned i = 0; i < 8; ++i) bits.push_back((byte >> i & 1U) != 0);
    bits.push_back(true);
  }
  bits.insert(bits.end(), 40, true);
  return bits;
}

/// What a receiver at another rate takes from the line: each bit is sampled in its middle; a byte
/// without its stop bit is kept as well, as most controllers keep it.
ByteString received(const ByteString& sent, double sent_rate, double own_rate, double phase) {
  const std::vector<bool> line = line_of(sent);
  const double end = static_cast<double>(line.size()) / sent_rate;
  const auto level = [&](double time) {
    const auto index = static_cast<std::size_t>(time * sent_rate);
    return index >= line.size() || line[index];
  };
  ByteString bytes;
  const double step = 1 / (16 * own_rate);  // a receiver looks 16 times a bit for a falling edge
  for (double time = phase * step; time < end;) {
    if (level(time)) {
      time += step;
      continue;
    }
    const double middle = time + 0.5 / own_rate;
    if (level(middle)) {  // no start bit: a spike
      time += step;
      continue;
    }
    unsigned byte = 0;
    for (unsigned i = 0; i < 8; ++i)
      if (level(middle + (i + 1) / own_rate)) byte |= 1U << i;
    bytes.push_back(static_cast<std::uint8_t>(byte));
    time = middle + 9 / own_rate;
    while (time < end && !level(time)) time += step;  // a break: until the line is at rest again
  }
  return bytes;
}

/// An instrument at a rate: at another one it hears what a UART makes of the bytes, and its answers
/// arrive so too.
struct AtRate final : BytePeer {
  AtRate(BytePeer& its_peer, int its_rate) : peer(its_peer), own_rate(its_rate) {}
  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    const ByteString sent(bytes.begin(), bytes.end());
    peer.receive(rate == own_rate ? sent : received(sent, rate, own_rate, 0.5), now);
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> said = peer.say(now);
    if (rate != own_rate)
      for (TimedBytes& one : said) one.bytes = received(one.bytes, own_rate, rate, 0.5);
    return said;
  }
  Time next() const override { return peer.next(); }

  BytePeer& peer;
  const int own_rate;
  int rate = 0;  // of the port now
};

struct Silent final : BytePeer {
  void receive(std::span<const std::uint8_t> bytes, Time) override {
    heard.append(bytes.begin(), bytes.end());
  }
  std::vector<TimedBytes> say(Time) override { return {}; }
  Time next() const override { return kForever; }
  std::string heard;
};

struct Asking : SerialBench {
  /// Of an instrument that hears at any rate, as a pseudo-terminal lets it.
  AskingResult ask(BytePeer& peer, const std::string& address = "serial:/dev/ttyS0") {
    const OpenLine open = [&](const SerialSettings& line) {
      opened.push_back(line.baud_rate);
      return link_to(peer);
    };
    return ask_port(plan_asking(address, identified_drivers()), open, *clock, tell);
  }
  AskingResult ask_at_rate(BytePeer& peer, int rate) {
    AtRate end(peer, rate);
    const OpenLine open = [&](const SerialSettings& line) {
      opened.push_back(line.baud_rate);
      end.rate = line.baud_rate;
      return link_to(end);
    };
    return ask_port(plan_asking("serial:/dev/ttyS0", identified_drivers()), open, *clock, tell);
  }

  std::vector<int> opened;
  Names told;
  TellStep tell = [this](const std::string& line) { told.push_back(line); };
};

/// The table of the likeliest role.
std::string table_of(const AskingResult& result) {
  if (result.found.empty()) return "";
  return rig_table(result.found.front(), result.found.front().roles.front());
}

TEST_F(Asking, RecognizesEachEmulatorAtItsOwnRateAndWritesItsTable) {
  const auto zaber = zaber::make_emulator({{}});
  EXPECT_EQ(table_of(ask_at_rate(*zaber, 115200)),
            "stage = { -- Zaber device 50081, serial 12345, firmware 7.14 at 115200 baud\n"
            "  driver = \"zaber\",\n  address = \"serial:/dev/ttyS0\",\n"
            "  baud_rate = 115200,\n  z = { device = 1, axis = 1 },\n"
            "  -- which axis is x, y or z, and `step` of its data sheet (m)\n},\n");
  const auto mp285 = sutter_mp285::make_emulator();
  const AskingResult stage = ask_at_rate(*mp285, 9600);
  ASSERT_EQ(stage.found.size(), 1U);
  EXPECT_EQ(stage.found[0].driver, "sutter_mp285");
  EXPECT_EQ(stage.found[0].baud_rate, 9600);
  const auto mpc200 = sutter_mpc200::make_emulator();
  EXPECT_NE(table_of(ask_at_rate(*mpc200, 128000)).find("drive = 1"), std::string::npos);
  const auto bop = kepco_bop::make_emulator();
  const AskingResult coils = ask_at_rate(*bop, 19200);
  ASSERT_EQ(coils.found.size(), 1U);
  EXPECT_EQ(coils.found[0].driver, "kepco_bop");
  EXPECT_EQ(coils.found[0].baud_rate, 19200);
  const auto probe = scpi_probe::make_emulator({}, [](Time) { return std::vector<double>{1.}; });
  const AskingResult field = ask_at_rate(*probe, 57600);
  ASSERT_EQ(field.found.size(), 1U);
  EXPECT_EQ(field.found[0].driver, "scpi_probe");
  EXPECT_NE(table_of(field).find("baud_rate = 57600"), std::string::npos) << table_of(field);
}

TEST_F(Asking, RecognizesThemWhereThePortHasNoRate) {
  const auto zaber = zaber::make_emulator({{}});
  const auto mp285 = sutter_mp285::make_emulator();
  const auto mpc200 = sutter_mpc200::make_emulator();
  const auto bop = kepco_bop::make_emulator();
  const auto probe = scpi_probe::make_emulator({}, [](Time) { return std::vector<double>{1.}; });
  const std::vector<std::pair<std::string, BytePeer*>> all{{"zaber", zaber.get()},
                                                           {"sutter_mp285", mp285.get()},
                                                           {"sutter_mpc200", mpc200.get()},
                                                           {"kepco_bop", bop.get()},
                                                           {"scpi_probe", probe.get()}};
  for (const auto& [driver, peer] : all) {
    const AskingResult result = ask(*peer, "tcp:10.0.0.7:5025");
    ASSERT_EQ(result.found.size(), 1U) << driver;
    EXPECT_EQ(result.found[0].driver, driver);
    EXPECT_EQ(table_of(result).find("baud_rate"), std::string::npos);
    EXPECT_EQ(opened, std::vector<int>{0}) << "one connection is enough";
    opened.clear();
  }
}

TEST_F(Asking, NamesTheAxesAndDevicesOfAChain) {
  zaber::EmulatedDevice first{.address = 1, .axes = {{}, {}}};
  zaber::EmulatedDevice second{.address = 4, .axes = {{}}};
  const auto chain = zaber::make_emulator({first, second});
  const std::string table = table_of(ask(*chain));
  EXPECT_NE(table.find("x = { device = 1, axis = 1 },\n  y = { device = 1, axis = 2 },\n"
                       "  z = { device = 4, axis = 1 }"),
            std::string::npos)
      << table;
  const std::string all = to_text(ask(*chain));
  EXPECT_NE(all.find("-- Or:\n"), std::string::npos) << all;
  EXPECT_NE(all.find("-- rotation_stage = { -- Zaber"), std::string::npos) << all;
}

TEST_F(Asking, SetsNothingMovingAndLeavesWhereItStands) {
  // Those with a position, at each of their rates and at a port without a rate.
  const auto mpc200 = sutter_mpc200::make_emulator({.start = {80'000, 1, 2}});
  ask(*mpc200);
  ask_at_rate(*mpc200, 128000);
  EXPECT_EQ(mpc200->position(1, clock->now()), (sutter_mpc200::Usteps{80'000, 1, 2}));
  EXPECT_FALSE(mpc200->moving(clock->now()));
  const auto mp285 = sutter_mp285::make_emulator();
  const auto before = mp285->position(clock->now());
  ask(*mp285);
  ask_at_rate(*mp285, 19200);
  EXPECT_EQ(mp285->position(clock->now()), before);
  const auto bop = kepco_bop::make_emulator();
  ask(*bop);
  EXPECT_EQ(bop->current(), 0);
  EXPECT_FALSE(bop->output());
}

// A question that holds a byte which another one would obey comes after that one was asked.
TEST_F(Asking, NoQuestionReachesAnInstrumentThatWouldObeyIt) {
  for (const std::string address : {"serial:/dev/ttyS0", "tcp:10.0.0.7:5025"}) {
    const std::vector<IdentifiedDriver> drivers = identified_drivers();
    std::set<std::string> asked;
    const AskingPlan plan = plan_asking(address, drivers);
    for (std::size_t i = 0; i < plan.steps.size(); ++i) {
      for (const IdentifiedDriver& other : drivers) {
        const auto is = [&](const IdentifiedDriver& one) { return one.name == other.name; };
        const bool own =
            std::any_of(plan.steps[i].drivers.begin(), plan.steps[i].drivers.end(), is);
        const bool to_come =
            std::any_of(plan.steps.begin() + static_cast<std::ptrdiff_t>(i), plan.steps.end(),
                        [&](const AskingStep& step) {
                          return std::any_of(step.drivers.begin(), step.drivers.end(), is);
                        });
        if (own || !to_come) continue;
        for (const ByteString& message : plan.steps[i].question.messages)
          EXPECT_EQ(text_of_bytes(message).find_first_of(other.identification.commands),
                    std::string::npos)
              << plan.steps[i].drivers.front().name << " asks before " << other.name;
      }
    }
    EXPECT_GT(plan.steps.size(), 3U);
  }
  // And *IDN? would set an MPC-200 off: its N calibrates.
  const auto mpc200 = sutter_mpc200::make_emulator({.start = {80'000, 1, 2}});
  const std::string scpi = "\n*IDN?\n";
  mpc200->receive(bytes(scpi), clock->now());
  EXPECT_TRUE(mpc200->moving(clock->now())) << "or this order would need no care";
}

// At another rate a receiver sees other bytes. Until its own question has come, none of them may be
// one that an instrument obeys, whatever the moments at which it samples.
TEST_F(Asking, AtAnotherRateNoQuestionTurnsIntoACommand) {
  const std::vector<IdentifiedDriver> drivers = identified_drivers();
  const AskingPlan plan = plan_asking("serial:/dev/ttyS0", drivers);
  int checked = 0;
  for (std::size_t i = 0; i < plan.steps.size(); ++i) {
    for (std::size_t later_step = i + 1; later_step < plan.steps.size(); ++later_step) {
      const AskingStep& other = plan.steps[later_step];
      if (other.baud_rate == plan.steps[i].baud_rate) continue;
      const std::string_view commands = other.drivers.front().identification.commands;
      for (const ByteString& message : plan.steps[i].question.messages)
        for (double phase = 0; phase < 16; ++phase, ++checked)
          EXPECT_EQ(
              text_of_bytes(received(message, plan.steps[i].baud_rate, other.baud_rate, phase))
                  .find_first_of(commands),
              std::string::npos)
              << plan.steps[i].drivers.front().name << " at " << plan.steps[i].baud_rate
              << ", heard by " << other.drivers.front().name << " at " << other.baud_rate;
    }
  }
  EXPECT_GT(checked, 1000);
}

TEST_F(Asking, AnMp285ThatMovesIsStoppedAndSaidToBeBeforehand) {
  const auto mp285 = sutter_mp285::make_emulator();
  mp285->receive(sutter_mp285::encode(sutter_mp285::SetVelocity{100, true}), clock->now());
  mp285->receive(sutter_mp285::encode(sutter_mp285::Move{{25'000, 0, 0}}), clock->now());
  clock->sleep_for(2s);
  ASSERT_TRUE(mp285->moving(clock->now()));
  const AskingPlan plan = plan_asking("serial:/dev/ttyS0", identified_drivers());
  const std::string said = to_text(plan);
  EXPECT_NE(said.find("any byte stops a Sutter MP-285 that moves"), std::string::npos) << said;
  EXPECT_NE(said.find("\\x0A*IDN?\\x0A at 9600, 19200"), std::string::npos) << said;
  EXPECT_EQ(ask(*mp285).found.front().driver, "sutter_mp285");
  EXPECT_FALSE(mp285->moving(clock->now()));
}

TEST_F(Asking, OfSilenceItSaysWhatWasTried) {
  Silent silent;
  const AskingResult result = ask(silent);
  EXPECT_TRUE(result.found.empty());
  EXPECT_TRUE(result.heard.empty());
  EXPECT_NE(to_text(result).find("silence, to each question at each of its rates"),
            std::string::npos);
  const auto tried = [&](const std::string& line) {
    return std::find(told.begin(), told.end(), line) != told.end();
  };
  EXPECT_TRUE(tried("kepco_bop, scpi_logger, scpi_probe at 9600 baud: silence"));
  EXPECT_TRUE(tried("zaber at 115200 baud: silence"));
  EXPECT_TRUE(tried("sutter_mpc200 at 128000 baud: silence"));
  EXPECT_EQ(to_json(result)["questions"].size(), told.size());
  const double took = to_seconds(clock->now());
  EXPECT_LE(took, longest_time(result.plan) + 1e-9) << "as a person is told before";
  EXPECT_GT(took, 0.9 * longest_time(result.plan));
}

TEST_F(Asking, CallsAnEchoAnEcho) {
  EchoPeer echo;
  const AskingResult result = ask(echo);
  EXPECT_TRUE(result.found.empty());
  EXPECT_NE(to_text(result).find("an echo"), std::string::npos) << to_text(result);
  EXPECT_EQ(to_text(result).find("no driver knows"), std::string::npos);
  EXPECT_EQ(told.front().substr(told.front().find(": ")), ": an echo of what was sent");
}

/// An instrument whose echo is on.
struct Echoing final : BytePeer {
  explicit Echoing(BytePeer& its_peer) : peer(its_peer) {}
  void receive(std::span<const std::uint8_t> heard, Time now) override {
    said.push_back({now, {heard.begin(), heard.end()}});
    peer.receive(heard, now);
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> all = std::exchange(said, {});
    for (TimedBytes& one : peer.say(now)) all.push_back(std::move(one));
    return all;
  }
  Time next() const override { return said.empty() ? peer.next() : said.front().at; }
  BytePeer& peer;
  std::vector<TimedBytes> said;
};

TEST_F(Asking, RecognizesAnInstrumentThatEchoesAndAnswers) {
  const auto bop = kepco_bop::make_emulator();
  Echoing echoing(*bop);
  const AskingResult result = ask(echoing);
  ASSERT_EQ(result.found.size(), 1U) << to_text(result);
  EXPECT_EQ(result.found[0].driver, "kepco_bop");
}

TEST_F(Asking, ShowsAStrangersAnswerAndAsksNoFurtherRate) {
  Stranger pump("ACME syringe pump \x01 ready\r\n");
  const AskingResult odd = ask(pump);
  EXPECT_TRUE(odd.found.empty());
  const std::string said = to_text(odd);
  EXPECT_NE(said.find("something answers, and no driver knows it"), std::string::npos) << said;
  EXPECT_NE(said.find("ACME syringe pump \\x01 ready\\x0D\\x0A"), std::string::npos) << said;
  EXPECT_NE(said.find("9600 baud"), std::string::npos) << said;
  opened.clear();
  Stranger other("E1\r\nCOMMAND ERROR\r\n");
  ask(other);
  EXPECT_EQ(std::set<int>(opened.begin(), opened.end()).size(), 1U)
      << "text arrived whole: its rate is known";
}

TEST_F(Asking, WaitsForAnInstrumentThatAnswersAfterASecondAndAHalf) {
  const auto probe = scpi_probe::make_emulator({}, [](Time) { return std::vector<double>{1.}; });
  faults.late = 1500ms;
  EXPECT_EQ(ask(*probe, "tcp:10.0.0.7:7777").found.size(), 1U);
}

TEST_F(Asking, AnEndlessTalkerIsHeardOutAndALostPortIsAnError) {
  struct Talker final : BytePeer {
    void receive(std::span<const std::uint8_t>, Time) override {}
    std::vector<TimedBytes> say(Time now) override {
      std::vector<TimedBytes> said;
      for (; at <= now; at += 10ms) said.push_back({at, bytes("#")});
      return said;
    }
    Time next() const override { return at; }
    Time at{};
  } talker;
  const AskingResult result = ask(talker);
  EXPECT_TRUE(result.found.empty());
  EXPECT_FALSE(result.heard.empty());
  Silent silent;
  faults.unplugged = true;
  EXPECT_THROW(ask(silent), DeviceError);
}

TEST(Identification, APortHasItsAdaptersNameToo) {
  const TemporaryFolder folder;
  const auto file = [&](const char* name) { return (folder.path() / name).string(); };
  std::ofstream(file("ttyUSB0")) << "";
  std::ofstream(file("ttyUSB1")) << "";
  std::filesystem::create_directory(file("by-id"));
  std::filesystem::create_symlink("../ttyUSB1", file("by-id/usb-FTDI_FT232R_A1-if00-port0"));
  // As udev makes it, before the rename.
  std::filesystem::create_symlink("../ttyUSB1",
                                  file("by-id/.#usb-FTDI_FT232R_A1-if00-port092fe7b42f3e173c0"));
  EXPECT_EQ(lasting_name(file("ttyUSB1"), file("by-id")),
            file("by-id/usb-FTDI_FT232R_A1-if00-port0"));
  EXPECT_EQ(lasting_name(file("ttyUSB0"), file("by-id")), "");
  EXPECT_EQ(lasting_name(file("ttyUSB0"), file("none")), "");
}

TEST(Identification, EveryProposedRoleHasThatDriver) {
  const auto has = [](const auto& entries, const std::string& name) {
    return std::any_of(entries.begin(), entries.end(),
                       [&](const auto& entry) { return entry.name == name; });
  };
  for (const auto& [name, identification] : identified_drivers())
    for (const UsbKind& kind : identification.usb)
      for (const ProposedRole& role : kind.roles)
        EXPECT_TRUE((role.role == "coils" && has(drivers<CoilAmplifier>(), name)) ||
                    (role.role == "lamp" && has(drivers<Lamp>(), name)) ||
                    (role.role == "lens_mover" && has(drivers<LensMover>(), name)) ||
                    ((role.role == "joystick" || role.role == "pedal") &&
                     has(drivers<OperatorInput>(), name)))
            << name << " as " << role.role;
}

TEST(Identification, TheUsbNumbersAreThoseOfTheUdevRules) {
  EXPECT_EQ(driver_for(0x09DB, 0x009C), "usb3103");
  EXPECT_EQ(driver_for(0x1FFB, 0x00B3), "pololu_tic");
  EXPECT_EQ(driver_for(0x256F, 0xC635), "spacemouse");
  EXPECT_EQ(driver_for(0x05F3, 0x0268), "foot_pedal");
  EXPECT_EQ(driver_for(0x1234, 0x5678), "");
}

std::string own_scripts() {
  return (std::filesystem::path(__FILE__).parent_path() / "../../../scripts").string();
}

// Each file whose identity is a plain question is found by its own emulator, and by no other file's
// question before that.
TEST_F(Asking, EveryShippedFileWithAPlainQuestionIsFoundByIt) {
  const std::vector<std::string> folders{own_scripts()};
  const auto files = asked_files(folders);
  ASSERT_GE(files.size(), 6U);
  RigDescription none;
  none.folders = folders;
  for (const auto& file : files) {
    const auto text = find_instrument_file(none, "/nowhere/", file->name);
    ASSERT_TRUE(text) << file->name;
    const auto emulator = scripted::make_emulator(load_instrument(*text), {});
    AtRate end(*emulator, file->line.baud_rate);
    const OpenLine open = [&](const SerialSettings& line) {
      end.rate = line.baud_rate;
      return link_to(end);
    };
    const AskingPlan plan =
        with_files(plan_asking("serial:/dev/ttyS0", identified_drivers()), files);
    const AskingResult result = ask_port(plan, open, *clock, tell);
    // Two controllers of temperature have no name: what one asks for the other has as well.
    ASSERT_EQ(result.found.size(), 1U) << file->name;
    if (result.found.front().driver == "scpi_probe") continue;  // any *IDN? of a gaussmeter
    EXPECT_EQ(result.found.front().driver, file->name);
  }
}

TEST_F(Asking, NoFilesQuestionIsAskedBeforeTheDrivers) {
  const AskingPlan plan = with_files(plan_asking("serial:/dev/ttyS0", identified_drivers()),
                                     asked_files({own_scripts()}));
  bool files = false;
  for (const AskingStep& step : plan.steps) {
    EXPECT_FALSE(files && !step.file) << "a driver's question behind a file's";
    files = files || step.file != nullptr;
  }
  EXPECT_TRUE(files);
  EXPECT_LE(longest_time(plan), 35);  // s, at a port that is silent: as docs/instruments.md says
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
