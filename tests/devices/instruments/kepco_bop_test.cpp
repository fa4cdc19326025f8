// Kepco BOP supplies as one amplifier: SCPI lines, the contract of the role, oddities by name, bad
// days.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/coil_amplifier.h"
#include "devices/instruments/kepco_bop/driver.h"
#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/kepco_bop/wire.h"
#include "devices/links/address.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/devices/links/real_end.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::kepco_bop {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Currents = std::vector<double>;
using Findings = std::vector<std::string>;

TEST(ScpiWire, ReadsNumbersAsInstrumentsWriteThem) {
  EXPECT_EQ(scpi::number("2.71E1"), 27.1);
  EXPECT_EQ(scpi::number("\x13+1.50000E+00\x11\r"), 1.5);
  EXPECT_EQ(scpi::number(" -0.5 "), -0.5);
  for (const char* bad : {"", "+", "+-1", "1,2", "ON", "nan", "1e999", "1 2"})
    EXPECT_FALSE(scpi::number(bad)) << bad;
}

TEST(ScpiWire, ReadsAnIdentityAndAnError) {
  const auto who = scpi::identity("KEPCO,BOP 36-12MG,A123456,1.74\r\n");
  ASSERT_TRUE(who);
  EXPECT_EQ(to_string(*who), "KEPCO BOP 36-12MG, serial A123456, firmware 1.74");
  EXPECT_FALSE(scpi::identity("KEPCO"));
  // Found by identification_fuzz: nothing behind "REV".
  EXPECT_EQ(kepco_bop::decode_identity("KEPCO BIT REV")->firmware, "");
  EXPECT_EQ(kepco_bop::decode_identity("KEPCO BOP BIT232 REV. 3.1")->firmware, "3.1");
  EXPECT_FALSE(scpi::identity("@01 0 RJ\x02,"));
  EXPECT_EQ(scpi::error("-222,\"Data out of range\"")->code, -222);
  EXPECT_EQ(scpi::error("0,\"No error\"")->text, "\"No error\"");
  EXPECT_FALSE(scpi::error("No error"));
}

TEST(KepcoWire, SetsACurrentAndAsksForWhatFlows) {
  EXPECT_EQ(set_and_measure(-1.5), "CURR -1.50000;:MEAS:CURR?;:SYST:ERR?");
  EXPECT_EQ(with_number("VOLT", -1e-9), "VOLT 0.00000");
  const auto measured = decode_measured("-1.50000E+00;0,\"No error\"");
  ASSERT_TRUE(measured);
  EXPECT_EQ(measured->current, -1.5);
  EXPECT_EQ(measured->error.code, 0);
  for (const char* bad : {"", "1.5", "x;0,\"\"", "1.5;", ";0,\"No error\""})
    EXPECT_FALSE(decode_measured(bad)) << bad;
}

TEST(KepcoWire, TakesItsCommandsBack) {
  EXPECT_EQ(decode_command(" :curr -1.5\r").header, "CURR");
  EXPECT_EQ(decode_command(" :curr -1.5\r").value, "-1.5");
  EXPECT_EQ(decode_command("MEAS:CURR?").header, "MEAS:CURR?");
  EXPECT_EQ(decode_command("").header, "");
}

struct Kepco : SerialBench {
  Kepco() {
    name = "coils";
    for (int i = 0; i < 8; ++i)
      add({.identity = "KEPCO,BOP 36-12MG,A" + std::to_string(100 + i) + ",1.74"});
  }
  void add(const EmulatorSettings& its) {
    emulators.push_back(make_emulator(its, [this](Time now, double) { changes.push_back(now); }));
    listeners.push_back(std::make_unique<Listener>(*emulators.back()));
    cables.push_back(std::make_unique<LinkFaults>());
  }
  std::unique_ptr<CoilAmplifier> open_all() {
    std::vector<std::unique_ptr<ByteLink>> links;
    for (std::size_t i = 0; i < listeners.size(); ++i)
      links.push_back(
          memory_byte_link(*listeners[i], *clock, {100us, 1042us / 2}, cables[i].get()));
    return open(std::move(links), settings, *clock);
  }
  void replace_by(const EmulatorSettings& its) {
    emulators.clear(), listeners.clear(), cables.clear();
    add(its);
  }
  Currents flowing() const {
    Currents currents;
    for (const auto& emulator : emulators) currents.push_back(emulator->current());
    return currents;
  }

  Settings settings;
  std::vector<Time> changes;
  std::vector<std::unique_ptr<Emulator>> emulators;
  std::vector<std::unique_ptr<Listener>> listeners;
  std::vector<std::unique_ptr<LinkFaults>> cables;
};

TEST_F(Kepco, KeepsTheContractOfACoilAmplifierWithEightUnits) {
  const auto coils = open_all();
  EXPECT_EQ(coils->channels(), 8);
  contract::CoilAmplifierCheck how;
  how.measured = [&] { return flowing(); };
  EXPECT_EQ(contract::check(*coils, how), Findings{});
  how.fraction = 1;
  EXPECT_EQ(contract::check(*coils, how), Findings{});
  EXPECT_EQ(flowing(), Currents(8));
}

TEST_F(Kepco, KeepsTheContractOverTcpAndOverAPseudoTerminal) {
  const auto real = virtual_clock(Pace::real_time);
  const auto on_lan = make_emulator({.network = true}),
             on_serial = make_emulator({.flow_control = false});
  RealEnd lan(*on_lan, open_tcp_end()), serial(*on_serial, open_pty_end());
  std::vector<std::unique_ptr<ByteLink>> links;
  links.push_back(open_byte_link(lan.address(), {}, *real));
  links.push_back(open_byte_link(serial.address(), {.baud_rate = 19200, .xon_xoff = true}, *real));
  settings.max_slope = 1e4;
  settings.step_time = 1e-3;
  const auto coils = open(std::move(links), settings, *real);
  contract::CoilAmplifierCheck how;
  how.measured = [&] {
    return Currents{lan.look([&] { return on_lan->current(); }),
                    serial.look([&] { return on_serial->current(); })};
  };
  EXPECT_EQ(contract::check(*coils, how), Findings{});
}

TEST_F(Kepco, OpensWithZeroCurrentRemoteControlAndAnActiveLoad) {
  const auto coils = open_all();
  EXPECT_EQ(flowing(), Currents(8));
  EXPECT_TRUE(emulators[7]->output());
  const std::string& said = listeners[0]->heard;
  EXPECT_LT(said.find("SYST:REM 1"), said.find("CURR 0"));
  EXPECT_LT(said.find("CURR 0"), said.find("OUTP ON"));
  EXPECT_LT(said.find("OUTP:MODE ACTIVE"), said.find("OUTP ON"));
  EXPECT_EQ(coils->identity(), "8 x KEPCO BOP 36-12MG, serial A100, firmware 1.74");
}

TEST_F(Kepco, BeginsWithEscapeForWhatADeadHostLeftBehind) {
  const std::string half = "CURR 1";
  emulators[0]->receive({reinterpret_cast<const std::uint8_t*>(half.data()), half.size()},
                        clock->now());
  const auto coils = open_all();
  EXPECT_EQ(listeners[0]->heard.front(), kClearInput);
}

TEST_F(Kepco, StripsTheFlowControlThatAnswersAreWrappedIn) {
  replace_by({.flow_control = true});
  const auto coils = open_all();
  coils->set_currents(Currents{1.5});
  EXPECT_EQ(coils->measured_currents(), Currents{1.5});
}

TEST_F(Kepco, ManagesWithoutAnEmptyLineAfterEachSetCommand) {
  replace_by({.network = true});
  const auto coils = open_all();
  coils->set_currents(Currents{-1.5});
  EXPECT_EQ(flowing(), Currents{-1.5});
}

TEST_F(Kepco, RampsLargeStepsBecauseTheCoilsAreInductive) {
  settings.max_slope = 100;
  const auto coils = open_all();
  changes.clear();
  const Time before = clock->now();
  Currents wanted(8);
  wanted[0] = 10;
  coils->set_currents(wanted);
  EXPECT_EQ(changes.size(), 5U);  // 10 A at 2 A a step
  EXPECT_GE(clock->now() - before, 4 * 20ms);
  EXPECT_EQ(flowing(), wanted);
}

TEST_F(Kepco, MakesSafeAtOnceAndNotByARamp) {
  const auto coils = open_all();
  coils->set_currents(Currents(8, 10.));
  changes.clear();
  coils->make_safe();
  EXPECT_EQ(changes.size(), 8U);
  EXPECT_EQ(flowing(), Currents(8));
}

TEST_F(Kepco, NoticesACurrentThatDoesNotFlow) {
  replace_by({.gain = 0.5});
  const auto coils = open_all();
  coils->set_currents(Currents{4});
  clock->sleep_for(1s);
  EXPECT_EQ(
      kind_of([&] { coils->set_currents(Currents{4}); }, "channel 1: 2 A flow where 4 A were set"),
      DeviceErrorKind::refused);
}

TEST_F(Kepco, RefusesALimitThatTheSupplyDoesNotHave) {
  settings.current_limit = 15;
  EXPECT_EQ(kind_of([&] { open_all(); }, "CURR:LIM"), DeviceErrorKind::refused);
}

TEST_F(Kepco, FindsNoBopBehindForeignAnswersOrSilence) {
  for (const char* answer : {"@01 0 RJ IDLE -- BADCOMMAND\r\n", "LakeShore,475,1,1\r\n"}) {
    Stranger stranger(answer);
    const auto open_stranger = [&] {
      std::vector<std::unique_ptr<ByteLink>> links;
      links.push_back(link_to(stranger));
      open(std::move(links), settings, *clock);
    };
    EXPECT_EQ(kind_of(open_stranger, "no Kepco BOP"), DeviceErrorKind::not_found);
  }
  cables[3]->silent = true;
  EXPECT_EQ(kind_of([&] { open_all(); }), DeviceErrorKind::timeout);
}

TEST_F(Kepco, SetsTheOtherChannelsToZeroWhenOneIsLost) {
  const auto coils = open_all();
  coils->set_currents(Currents(8, 2.));
  cables[3]->unplugged = true;
  EXPECT_EQ(kind_of([&] { coils->set_currents(Currents(8, 1.)); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { coils->make_safe(); }), DeviceErrorKind::lost);
  Currents expected(8);
  expected[3] = 2;  // it cannot be reached
  EXPECT_EQ(flowing(), expected);
  EXPECT_EQ(coils->currents()[3], 1.);  // the last that was tried, and not claimed to be zero
}

TEST_F(Kepco, TheEmulatorTellsThatNothingFlowsAfterAResetOrAPowerCut) {
  std::vector<double> told;
  const auto supply = make_emulator({}, [&](Time, double current) { told.push_back(current); });
  for (const bool reset : {true, false}) {
    supply->receive(bytes("SYST:REM ON;:FUNC:MODE CURR;:OUTP ON;:CURR 2\r"), 0s);
    ASSERT_DOUBLE_EQ(supply->current(), 2);
    if (reset)
      supply->receive(bytes("*RST\r"), 1s);
    else
      supply->power_cycle(1s);
    EXPECT_DOUBLE_EQ(supply->current(), 0);
    EXPECT_EQ(told.back(), 0);
  }
}

TEST_F(Kepco, OpensALostChannelAgainAtZeroAndDropsItsSetPoint) {
  const auto coils = open_all();
  coils->set_currents(Currents(8, 2.));
  cables[3]->unplugged = true;
  EXPECT_EQ(kind_of([&] { coils->make_safe(); }), DeviceErrorKind::lost);
  emulators[3]->power_cycle(clock->now());
  cables[3]->unplugged = false;
  EXPECT_EQ(kind_of([&] { coils->set_currents(Currents(8, 1.)); }), DeviceErrorKind::lost);
  listeners[3]->heard.clear();
  coils->make_safe();
  EXPECT_EQ(flowing(), Currents(8));
  EXPECT_EQ(listeners[3]->count("OUTP ON"), 1);
  EXPECT_EQ(listeners[3]->count("CURR:LIM:POS?"), 1);
  EXPECT_NO_THROW(coils->set_currents(Currents(8, 1.)));
  EXPECT_EQ(flowing(), Currents(8, 1.));
}

TEST_F(Kepco, RecoversAfterALateShortOrGarbledAnswer) {
  const auto coils = open_all();
  cables[2]->late = 700ms;
  EXPECT_EQ(kind_of([&] { coils->set_currents(Currents(8, 1.)); }), DeviceErrorKind::timeout);
  clock->sleep_for(1s);
  cables[2]->late = 0ms;
  EXPECT_NO_THROW(coils->set_currents(Currents(8, 1.)));
  cables[2]->keep = 5;
  EXPECT_EQ(kind_of([&] { coils->set_currents(Currents(8, 1.)); }), DeviceErrorKind::timeout);
  cables[2]->keep = -1;
  cables[2]->garble = 2;  // behind the CR LF that answers its ESC
  EXPECT_EQ(kind_of([&] { coils->set_currents(Currents(8, 1.)); }, "channel 3"),
            DeviceErrorKind::protocol);
  cables[2]->garble = -1;
  EXPECT_NO_THROW(coils->set_currents(Currents(8, 1.)));
  EXPECT_EQ(coils->measured_currents(), Currents(8, 1.));
}

TEST_F(Kepco, EndsAtZeroWithItsOutputsOff) {
  auto coils = open_all();
  coils->set_currents(Currents(8, 10.));
  changes.clear();
  coils.reset();
  EXPECT_EQ(changes.size(), 8U);  // at once: a ramp would take five set-points a supply
  EXPECT_EQ(flowing(), Currents(8));
  EXPECT_FALSE(emulators[0]->output());
}

TEST_F(Kepco, EndsAtZeroInATaskThatIsStopped) {
  const auto servo = clock->spawn("servo", [&] {
    const auto coils = open_all();
    for (;; clock->sleep_for(3ms)) coils->set_currents(Currents(8, 1.));
  });
  clock->sleep_for(5s);
  EXPECT_EQ(flowing(), Currents(8, 1.));
  servo->request_stop();
  servo->join();
  EXPECT_EQ(flowing(), Currents(8));
}

TEST_F(Kepco, ThrowsForSettingsThatMakeNoSense) {
  const auto bad = [&](auto change) {
    Settings wrong = settings;
    change(wrong);
    EXPECT_THROW(wrong.check(), std::invalid_argument);
  };
  bad([](Settings& s) { s.name.clear(); });
  bad([](Settings& s) { s.current_limit = 0; });
  bad([](Settings& s) { s.voltage_limit = -1; });
  bad([](Settings& s) { s.max_slope = std::nan(""); });
  bad([](Settings& s) { s.read_back_tolerance = 0; });
  EXPECT_THROW(open({}, settings, *clock), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::kepco_bop
