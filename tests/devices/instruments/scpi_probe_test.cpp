// The SCPI teslameter: its lines, the contract of its role over memory, a pseudo-terminal and TCP,
// and bad days.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/field_probe.h"
#include "devices/instruments/scpi_probe/driver.h"
#include "devices/instruments/scpi_probe/emulator.h"
#include "devices/instruments/scpi_probe/wire.h"
#include "devices/links/address.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/real_end.h"

#include <stdexcept>

namespace vitreo::scpi_probe {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Field = std::vector<double>;
using Findings = std::vector<std::string>;

TEST(ScpiProbeWire, ReadsAsManyNumbersAsThereAreAxes) {
  EXPECT_EQ(decode_field("1.2E-3,-4.5E-3, 0.1E-3\r", 3), (Field{1.2e-3, -4.5e-3, 0.1e-3}));
  EXPECT_EQ(encode_field({1.2e-3, -4.5e-3}), "+1.200000E-03,-4.500000E-03");
  EXPECT_EQ(decode_field(encode_field({0.25}), 1), Field{0.25});
  EXPECT_FALSE(decode_field("1,2", 3));
  EXPECT_FALSE(decode_field("1,,2", 3));
  EXPECT_FALSE(decode_field("", 1));
  EXPECT_FALSE(decode_field("OVERLOAD", 1));
}

struct ScpiProbe : SerialBench {
  ScpiProbe() { name = "field_probe"; }
  std::unique_ptr<FieldProbe> open_probe() { return open(link_to(listener), settings, *clock); }

  Settings settings{.model = "PROBE-3", .setup = "", .axes = 3, .unit = 1e-3};  // it speaks mT
  Field field{1, -20, 0.5};                                                     // mT
  std::unique_ptr<BytePeer> emulator =
      make_emulator({.range = 100}, [this](Time) { return field; });
  Listener listener{*emulator};
};

TEST_F(ScpiProbe, KeepsTheContractOfAFieldProbe) {
  const auto probe = open_probe();
  contract::FieldProbeCheck how;
  how.really = [] { return Field{1e-3, -20e-3, 0.5e-3}; };
  EXPECT_EQ(contract::check(*probe, *clock, how), Findings{});
  EXPECT_EQ(to_string(probe->info().identity), "VITREO PROBE-3, serial P001, firmware 1.0");
}

TEST_F(ScpiProbe, KeepsTheContractOverAPseudoTerminalAndOverTcp) {
  const auto real = virtual_clock(Pace::real_time);
  for (auto open_end : {+[] { return open_pty_end(); }, +[] { return open_tcp_end(); }}) {
    RealEnd end(*emulator, open_end());
    const auto probe = open(open_byte_link(end.address(), {}, *real), settings, *real);
    EXPECT_EQ(contract::check(*probe, *real), Findings{});
  }
}

TEST_F(ScpiProbe, RefusesToGiveAFieldBeyondItsRange) {
  const auto probe = open_probe();
  field = {1, 101, 0};
  EXPECT_EQ(kind_of([&] { probe->measure(1s); }, "beyond its range"), DeviceErrorKind::refused);
  field = {1, 99, 0};
  EXPECT_EQ(probe->measure(1s).field, (Field{1e-3, 99e-3, 0}));
}

TEST_F(ScpiProbe, IsSetUpAndNoticesASetupThatIsRefused) {
  settings.setup = "SENS:NONE|FORM ASC";
  EXPECT_EQ(kind_of([&] { open_probe(); }, "does not take its setup"), DeviceErrorKind::refused);
  EXPECT_EQ(listener.count("SENS:NONE\n"), 1);
}

TEST_F(ScpiProbe, FindsTheWrongInstrument) {
  settings.model = "475";
  EXPECT_EQ(kind_of([&] { open_probe(); }, "no 475"), DeviceErrorKind::not_found);
  faults.silent = true;
  EXPECT_EQ(kind_of([&] { open_probe(); }), DeviceErrorKind::timeout);
}

TEST_F(ScpiProbe, TakesNoAnswerToAnOlderQuestion) {
  const auto probe = open_probe();
  faults.late = 1s;
  EXPECT_EQ(kind_of([&] { probe->measure(500ms); }), DeviceErrorKind::timeout);
  clock->sleep_for(5s);
  faults.late = 0s;
  field = {2, 2, 2};
  EXPECT_EQ(probe->measure(1s).field, (Field{2e-3, 2e-3, 2e-3}));
}

TEST_F(ScpiProbe, NoticesGarbledAndShortAnswersAndALostLink) {
  const auto probe = open_probe();
  faults.garble = 3;
  EXPECT_EQ(kind_of([&] { probe->measure(1s); }, "not 3 numbers"), DeviceErrorKind::protocol);
  faults = {};
  faults.keep = 10;
  EXPECT_EQ(kind_of([&] { probe->measure(1s); }), DeviceErrorKind::timeout);
  faults = {};
  faults.unplugged = true;
  EXPECT_EQ(kind_of([&] { probe->measure(1s); }), DeviceErrorKind::lost);
  faults.unplugged = false;
  EXPECT_EQ(probe->measure(1s).field.size(), 3U);  // opens it anew
}

TEST_F(ScpiProbe, ThrowsForSettingsThatMakeNoSense) {
  const auto bad = [&](auto change) {
    Settings wrong = settings;
    change(wrong);
    EXPECT_THROW(open(link_to(*emulator), wrong, *clock), std::invalid_argument);
  };
  bad([](Settings& s) { s.question.clear(); });
  bad([](Settings& s) { s.axes = 2; });
  bad([](Settings& s) { s.unit = 0; });
  bad([](Settings& s) { s.range = -1; });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::scpi_probe
