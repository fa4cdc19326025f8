// The data logger: its lines, the contract of its role over memory, a pseudo-terminal and TCP, and
// bad days.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/current_sensor.h"
#include "devices/instruments/scpi_logger/driver.h"
#include "devices/instruments/scpi_logger/emulator.h"
#include "devices/instruments/scpi_logger/wire.h"
#include "devices/links/address.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/real_end.h"

#include <map>
#include <stdexcept>

namespace vitreo::scpi_logger {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Findings = std::vector<std::string>;

TEST(ScpiLoggerWire, ReadsASweepByItsChannels) {
  EXPECT_EQ(decode_sweep("+1.5E+00,101,-2.0E-03,104\r"),
            (std::map<int, double>{{101, 1.5}, {104, -2e-3}}));
  EXPECT_FALSE(decode_sweep("+1.5E+00,101,-2.0E-03")) << "a channel is missing";
  EXPECT_FALSE(decode_sweep("+1.5E+00,101,-2.0E-03,101")) << "twice";
  EXPECT_FALSE(decode_sweep("+1.5E+00 VDC,101"));
  EXPECT_FALSE(decode_sweep("+1.5E+00,101.5"));
  EXPECT_FALSE(decode_sweep(""));
  EXPECT_EQ(channel_list({101, 203}), "(@101,203)");
}

struct ScpiLogger : SerialBench {
  ScpiLogger() { name = "current_sensor"; }
  std::unique_ptr<CurrentSensor> open_logger() { return open(link_to(listener), settings, *clock); }

  /// Coil 1 by a transducer, coil 3 by a shunt that is wired the other way round.
  Settings settings{.coils = {{0, 104, 10}, {2, 101, -2}}};
  std::map<int, double> volts{{101, 0.75}, {104, 0.3}};
  std::unique_ptr<BytePeer> emulator =
      make_emulator({}, [this](int channel, Time) { return volts[channel]; });
  Listener listener{*emulator};
};

TEST_F(ScpiLogger, KeepsTheContractOfACurrentSensor) {
  const auto sensor = open_logger();
  EXPECT_EQ(sensor->info().coils, (std::vector<int>{0, 2}));
  contract::CurrentSensorCheck how;
  how.really = [] { return std::vector<double>{3, -1.5}; };
  how.tolerance = 1e-6;
  EXPECT_EQ(contract::check(*sensor, how), Findings{});
  EXPECT_EQ(to_string(sensor->info().identity),
            "HEWLETT-PACKARD 34970A, serial 0, firmware 13-2-2");
}

TEST_F(ScpiLogger, KeepsTheContractOverAPseudoTerminalAndOverTcp) {
  const auto real = virtual_clock(Pace::real_time);
  for (auto open_end : {+[] { return open_pty_end(); }, +[] { return open_tcp_end(); }}) {
    RealEnd end(*emulator, open_end());
    const auto sensor = open(open_byte_link(end.address(), {}, *real), settings, *real);
    EXPECT_EQ(contract::check(*sensor), Findings{});
  }
}

TEST_F(ScpiLogger, RefusesACurrentBeyondItsRange) {
  const auto sensor = open_logger();
  volts[104] = 13;
  try {
    sensor->measure(1s);
    FAIL() << "taken";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::refused);
    EXPECT_NE(error.text.find("coil 1 (channel 104)"), std::string::npos) << error.text;
  }
}

TEST_F(ScpiLogger, IsNotOpenedOnAnotherInstrument) {
  settings.model = "DAQ970A";
  try {
    open_logger();
    FAIL() << "opened";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::not_found);
  }
}

TEST(ScpiLoggerSettings, AreRefusedWhereTheyCannotBe) {
  const auto refused = [](const Settings& settings) {
    try {
      settings.check();
      return false;
    } catch (const std::invalid_argument&) {
      return true;
    }
  };
  EXPECT_FALSE(refused({.coils = {{0, 101, 1}}}));
  EXPECT_TRUE(refused({.coils = {}}));
  EXPECT_TRUE(refused({.coils = {{0, 99, 1}}}));
  EXPECT_TRUE(refused({.coils = {{0, 101, 1}, {0, 102, 1}}}));
  EXPECT_TRUE(refused({.coils = {{0, 101, 1}, {1, 101, 1}}}));
  EXPECT_TRUE(refused({.coils = {{0, 101, 0}}}));
  EXPECT_TRUE(refused({.coils = {{0, 101, 1}}, .line_cycles = 0.3}));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::scpi_logger
