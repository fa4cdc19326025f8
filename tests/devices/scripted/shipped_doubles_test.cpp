// Instruments that ship as one Lua file each, against doubles by another hand. On the wall clock,
// over real lines.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/field_probe.h"
#include "devices/contract/instrument.h"
#include "devices/contract/stage.h"
#include "devices/links/address.h"
#include "devices/links/message_bytes.h"
#include "devices/links/usbtmc_link.h"
#include "devices/scripted/instrument.h"
#include "devices/time/error.h"
#include "tests/devices/doubles/double_process.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Findings = std::vector<std::string>;
using Options = std::vector<std::string>;
using scripted::Opening;

/// The units that the shipped files name; the host's table is above this room.
std::optional<scripted::DeclaredUnit> unit_of(std::string_view symbol) {
  const std::vector<scripted::DeclaredUnit> known{
      {"mm", "m", 1e-3, 0},   {"mm/s", "m/s", 1e-3, 0},
      {"T", "T", 1, 0},       {"mL/min", "m^3/s", 1e-6 / 60, 0},
      {"mL", "m^3", 1e-6, 0}, {"degC", "K", 1, 273.15},
      {"V", "V", 1, 0},       {"A", "A", 1, 0},
      {"s", "s", 1, 0}};
  for (const auto& one : known)
    if (one.symbol == symbol) return one;
  return std::nullopt;
}

scripted::Loaded shipped(const std::string& name, const scripted::SettingValues& values = {}) {
  std::ifstream in(VITREO_SOURCE_DIR "/scripts/instruments/" + name + ".lua");
  std::ostringstream text;
  text << in.rdbuf();
  return scripted::load(name + ".lua", text.str(), unit_of, values);
}

/// The driver on its line to a double. The settings of the line are the file's own.
Opening on_double(const std::string& name, const DoubleProcess& instrument, Clock& clock,
                  const scripted::SettingValues& values = {}) {
  scripted::Loaded loaded = shipped(name, values);
  SerialSettings serial = loaded.declaration.link.serial;
  serial.data_bits = 8;  // of a pseudo-terminal
  serial.parity = Parity::none;
  auto link = open_byte_link(instrument.address(), serial, clock);
  return {std::move(loaded), std::move(link), name, clock};
}

std::size_t index_of(const Instrument& instrument, const std::string& name) {
  const auto& all = instrument.info().quantities;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (all[i].name == name) return i;
  throw std::out_of_range(name);
}
/// What was sent has reached the double, and not only the kernel.
std::string order_after(Clock& clock, DoubleProcess& instrument, const std::string& order) {
  clock.sleep_for(200ms);
  return instrument.order(order);
}
double number(Instrument& instrument, const std::string& name) {
  return std::get<double>(instrument.read(index_of(instrument, name), 5s).value);
}
bool flag(Instrument& instrument, const std::string& name) {
  return std::get<bool>(instrument.read(index_of(instrument, name), 5s).value);
}
void set(Instrument& instrument, const std::string& name, const QuantityValue& value) {
  instrument.set(index_of(instrument, name), value);
}
void command(Instrument& instrument, const std::string& name,
             const std::vector<QuantityValue>& arguments = {}) {
  const auto& all = instrument.info().commands;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (all[i].name == name) return instrument.command(i, arguments);
  throw std::out_of_range(name);
}

template <class Work>
DeviceErrorKind kind_of(const Work& work) {
  try {
    work();
  } catch (const DeviceError& error) {
    std::printf("  %s\n", error.what());
    return error.kind;
  }
  ADD_FAILURE() << "it was taken";
  return DeviceErrorKind::lost;
}

std::string name_of(const Options& options) {
  std::string name;
  for (const std::string& option : options) name += (name.empty() ? "" : "_") + option;
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return name.empty() ? "plain" : name;
}

// Kdc101

class Kdc101Double : public testing::TestWithParam<Options> {};
TEST_P(Kdc101Double, KeepsTheContractOfAStage) {
  const auto clock = wall_clock();
  Options options = GetParam();
  options.emplace_back("stage=Z812");  // the shortest: it homes from its middle
  DoubleProcess instrument("thorlabs_apt", options);
  const auto stage =
      scripted::open_stage(on_double("kdc101", instrument, *clock, {{"travel", 12.0}}));
  EXPECT_EQ(stage->info().identity.serial, "27250001");
  EXPECT_EQ(stage->info().identity.firmware, "1.2.3");
  contract::StageCheck how;
  how.home = true;
  how.way = 0.5e-3;
  how.start = {2e-3};
  EXPECT_EQ(contract::check(*stage, *clock, how), Findings{});
  EXPECT_EQ(instrument.number("ignored"), 0);
}
INSTANTIATE_TEST_SUITE_P(Ways, Kdc101Double,
                         testing::Values(Options{}, Options{"chatty=True"}, Options{"late=0.05"},
                                         Options{"swapped=True"}, Options{"idle_stop=False"},
                                         Options{"pieces=3", "gap=0.002"}),
                         [](const auto& made) { return name_of(made.param); });

TEST(Kdc101Double, AStageThatIsHeldIsToldAndAnotherControllerRefused) {
  const auto clock = wall_clock();
  {
    DoubleProcess instrument("thorlabs_apt");
    const auto stage = scripted::open_stage(on_double("kdc101", instrument, *clock));
    EXPECT_EQ(kind_of([&] { stage->start(std::vector{1e-3}, 1e-3); }), DeviceErrorKind::refused);
    stage->home(60s);
    instrument.order(R"({"set": {"slipping": true}})");
    EXPECT_EQ(kind_of([&] {
                stage->start(std::vector{1e-3}, 1e-3);
                stage->wait(4s);
              }),
              DeviceErrorKind::timeout);  // its status says that it moves
  }
  DoubleProcess other("thorlabs_apt", {"model=TDC001", "serial=83000001"});
  EXPECT_EQ(kind_of([&] { scripted::open_stage(on_double("kdc101", other, *clock)); }),
            DeviceErrorKind::not_found);
}

// Conex

class ConexDouble : public testing::TestWithParam<Options> {};
TEST_P(ConexDouble, KeepsTheContractOfAStage) {
  const auto clock = wall_clock();
  Options options = GetParam();
  options.emplace_back("travel=2.0");  // mm: it homes from its middle at 0.4 mm/s
  DoubleProcess instrument("newport_conex", options);
  const auto stage =
      scripted::open_stage(on_double("conex_cc", instrument, *clock, {{"travel_max", 2.0}}));
  contract::StageCheck how;
  how.home = true;
  how.way = 0.1e-3;
  how.start = {1e-3};
  EXPECT_EQ(contract::check(*stage, *clock, how), Findings{});
  EXPECT_EQ(instrument.number("writes"), 0);  // its flash is its owner's
}
INSTANTIATE_TEST_SUITE_P(Ways, ConexDouble,
                         testing::Values(Options{}, Options{"chatty=True"}, Options{"late=0.05"},
                                         Options{"ready_lag=0.09"}),
                         [](const auto& made) { return name_of(made.param); });

// Lake Shore

/// Late as it was told to be at its start, or later.
std::function<void(bool)> answering(DoubleProcess& instrument, const Options& options) {
  std::string usual = "0.0";
  for (const std::string& option : options)
    if (option.rfind("late=", 0) == 0) usual = option.substr(5);
  return [&instrument, usual](bool slow) {
    instrument.order(R"({"set": {"late": )" + (slow ? "0.1" : usual) + "}}");
  };
}

class LakeShoreDouble : public testing::TestWithParam<Options> {};
TEST_P(LakeShoreDouble, KeepsTheContractOfAFieldProbe) {
  const auto clock = wall_clock();
  DoubleProcess instrument("scpi_probe", GetParam());
  instrument.order(R"({"set": {"field": [0.001, 0.002, 0.0345]}})");
  const bool older = GetParam().front() == "model=425";
  const auto probe = scripted::open_field_probe(
      on_double(older ? "lake_shore_425" : "lake_shore_475", instrument, *clock));
  contract::FieldProbeCheck how;
  how.really = [] { return std::vector{0.0345}; };
  how.answer = answering(instrument, GetParam());
  EXPECT_EQ(contract::check(*probe, *clock, how), Findings{});
  EXPECT_EQ(instrument.number("lost"), 0);
}
INSTANTIATE_TEST_SUITE_P(
    Ways, LakeShoreDouble,
    testing::Values(Options{"model=475"}, Options{"model=425"}, Options{"model=475", "flow=True"},
                    Options{"model=425", "flow=True"}, Options{"model=475", "late=0.1"},
                    Options{"model=475", "chatty=True"}, Options{"model=425", "terminator=lf"}),
    [](const auto& made) { return name_of(made.param); });

TEST(LakeShoreDouble, AnotherModelIsRefused) {
  const auto clock = wall_clock();
  DoubleProcess instrument("scpi_probe", {"model=425"});
  EXPECT_EQ(
      kind_of([&] { scripted::open_field_probe(on_double("lake_shore_475", instrument, *clock)); }),
      DeviceErrorKind::not_found);
}

// Metrolab

class MetrolabDouble : public testing::TestWithParam<Options> {};
TEST_P(MetrolabDouble, KeepsTheContractOfAFieldProbe) {
  const auto clock = wall_clock();
  DoubleProcess instrument = DoubleProcess::on_socket("metrolab_thm1176", GetParam());
  instrument.order(R"({"set": {"field": [0.01, -0.02, 0.0345]}})");
  auto link = message_bytes(usbtmc_link(open_double_usbtmc(instrument.address(), *clock), *clock),
                            "\n", *clock);
  const auto probe =
      scripted::open_field_probe({shipped("thm1176"), std::move(link), "thm1176", *clock});
  EXPECT_EQ(probe->info().identity.serial, "0000803");
  contract::FieldProbeCheck how;
  how.really = [] { return std::vector{0.01, -0.02, 0.0345}; };
  how.tolerance = 50e-6;
  how.answer = answering(instrument, GetParam());
  EXPECT_EQ(contract::check(*probe, *clock, how), Findings{});
  EXPECT_EQ(instrument.order(R"({"get": "errors"})"), R"({"errors": []})");
  instrument.order(R"({"set": {"field": [0.5, 0, 0]}})");  // beyond 0.3 T
  EXPECT_EQ(kind_of([&] { probe->measure(2s); }), DeviceErrorKind::refused);
}
INSTANTIATE_TEST_SUITE_P(Ways, MetrolabDouble,
                         testing::Values(Options{}, Options{"unit_letters=lower"},
                                         Options{"fetch_waits=False"}, Options{"late=0.05"}),
                         [](const auto& made) { return name_of(made.param); });

TEST(MetrolabSeries, IsTakenByItsOwnClockAndReadAsLists) {
  const auto clock = wall_clock();
  DoubleProcess instrument = DoubleProcess::on_socket("metrolab_thm1176", {});
  instrument.order(R"({"set": {"field": [0.01, -0.02, 0.0345]}})");
  auto link = message_bytes(usbtmc_link(open_double_usbtmc(instrument.address(), *clock), *clock),
                            "\n", *clock);
  const auto probe = scripted::open_instrument(
      {shipped("thm1176_series"), std::move(link), "thm1176_series", *clock});
  EXPECT_NEAR(number(*probe, "value"), std::hypot(0.01, 0.02, 0.0345), 50e-6);
  const Time began = clock->now();
  command(*probe, "take", {QuantityValue(500.0), QuantityValue(2e-3)});
  EXPECT_GE(clock->now() - began, 1s);
  const auto z = std::get<std::vector<double>>(probe->read(index_of(*probe, "z"), 5s).value);
  EXPECT_EQ(z.size(), 500U);
  for (const double one : z) EXPECT_NEAR(one, 0.0345, 50e-6);
  EXPECT_EQ(instrument.order(R"({"get": "errors"})"), R"({"errors": []})");
  // Faster than its 6.8 kSa/s it cannot: it says so, and the next series is as good as before.
  EXPECT_EQ(kind_of([&] {
              command(*probe, "take", {QuantityValue(100.0), QuantityValue(122e-6)});
            }),
            DeviceErrorKind::refused);
  command(*probe, "take", {QuantityValue(2048.0), QuantityValue(250e-6)});
  EXPECT_EQ(std::get<std::vector<double>>(probe->read(index_of(*probe, "x"), 5s).value).size(),
            2048U);
  EXPECT_EQ(contract::check(*probe), Findings{});
}

// New Era

class NewEraDouble : public testing::TestWithParam<Options> {};
TEST_P(NewEraDouble, KeepsTheContractAndInfuses) {
  const auto clock = wall_clock();
  DoubleProcess instrument("new_era", GetParam());
  const auto pump = scripted::open_instrument(on_double("ne1000", instrument, *clock));
  EXPECT_EQ(contract::check(*pump), Findings{});
  set(*pump, "rate", 5e-6 / 60);
  EXPECT_NEAR(number(*pump, "rate"), 5e-6 / 60, 1e-12);
  command(*pump, "infuse", {0.05e-6});  // 0.6 s
  EXPECT_NEAR(instrument.number("infused_ml"), 0.05, 1e-3);
  EXPECT_FALSE(flag(*pump, "running"));
  command(*pump, "withdraw", {0.02e-6});
  EXPECT_NEAR(instrument.number("plunger_ml"), 0.03, 2e-3);
}
INSTANTIATE_TEST_SUITE_P(Ways, NewEraDouble,
                         testing::Values(Options{}, Options{"alarm_at_power_up=False"},
                                         Options{"late=0.1"}, Options{"pieces=2", "gap=0.005"}),
                         [](const auto& made) { return name_of(made.param); });

TEST(NewEraDouble, AStallIsToldAndWhatItRefusesTooAndItIsSafeInTheEnd) {
  const auto clock = wall_clock();
  DoubleProcess instrument("new_era");
  auto pump =
      scripted::open_instrument(on_double("ne1000", instrument, *clock, {{"largest_rate", 150.0}}));
  EXPECT_EQ(kind_of([&] { set(*pump, "rate", 140e-6 / 60); }), DeviceErrorKind::refused);
  set(*pump, "rate", 2e-6 / 60);
  instrument.order(R"({"set": {"blocked": true}})");
  EXPECT_EQ(kind_of([&] { command(*pump, "infuse", {0.1e-6}); }), DeviceErrorKind::refused);
  instrument.order(R"({"set": {"blocked": false}})");
  set(*pump, "rate", 1e-6 / 60);
  pump.reset();
  EXPECT_EQ(order_after(*clock, instrument, R"({"get": "running"})"), R"({"running": false})");
}

class WatchedNewEra : public testing::TestWithParam<Options> {};
TEST_P(WatchedNewEra, KeepsTheContractAndInfusesForLongerThanItMayBeSilent) {
  const auto clock = wall_clock();
  DoubleProcess instrument("new_era", GetParam());
  const auto pump =
      scripted::open_instrument(on_double("ne1000_safe", instrument, *clock, {{"silence", 2.0}}));
  EXPECT_EQ(contract::check(*pump), Findings{});
  set(*pump, "rate", 2e-6 / 60);
  EXPECT_NEAR(number(*pump, "rate"), 2e-6 / 60, 1e-12);
  command(*pump, "infuse", {0.1e-6});  // 3 s
  EXPECT_NEAR(instrument.number("infused_ml"), 0.1, 1e-3);
  EXPECT_EQ(instrument.order(R"({"get": "alarm"})"), R"({"alarm": ""})");
  EXPECT_NE(instrument.order(R"({"get": "safe_timer_ends"})").find("ends\": "), std::string::npos);
  EXPECT_EQ(instrument.order(R"({"get": "safe_timer_ends"})").find("null"), std::string::npos);
}
INSTANTIATE_TEST_SUITE_P(Ways, WatchedNewEra,
                         testing::Values(Options{}, Options{"alarm_at_power_up=False"},
                                         Options{"pieces=2", "gap=0.005"}),
                         [](const auto& made) { return name_of(made.param); });

TEST(WatchedNewEra, StopsByItselfWhenItsHostIsGoneAndAnotherOneTakesItUp) {
  const auto clock = wall_clock();
  DoubleProcess instrument("new_era");
  Opening first = on_double("ne1000_safe", instrument, *clock, {{"silence", 2.0}});
  const scripted::Framing framing = first.loaded.declaration.link.framing;
  scripted::open_instrument(std::move(first)).reset();
  // What a host says that dies with the pump running; nothing is said after it.
  auto link = open_byte_link(instrument.address(), {.baud_rate = 19200}, *clock);
  for (const char* message : {"", "VOL0", "RAT1.000MM", "RUN"}) {
    const std::string whole = scripted::framed(framing, message);
    link->write({reinterpret_cast<const std::uint8_t*>(whole.data()), whole.size()}, 1s);
    clock->sleep_for(100ms);
  }
  EXPECT_EQ(instrument.order(R"({"get": "running"})"), R"({"running": true})");
  clock->sleep_for(2500ms);
  EXPECT_EQ(instrument.order(R"({"get": "running"})"), R"({"running": false})");
  EXPECT_EQ(instrument.order(R"({"get": "alarm"})"), R"({"alarm": "T"})");
  link.reset();
  const auto pump =
      scripted::open_instrument(on_double("ne1000_safe", instrument, *clock, {{"silence", 2.0}}));
  EXPECT_FALSE(flag(*pump, "running"));
}

TEST(WatchedNewEra, AStallIsTold) {
  const auto clock = wall_clock();
  DoubleProcess instrument("new_era");
  const auto pump = scripted::open_instrument(on_double("ne1000_safe", instrument, *clock));
  set(*pump, "rate", 2e-6 / 60);
  instrument.order(R"({"set": {"blocked": true}})");
  EXPECT_EQ(kind_of([&] { command(*pump, "infuse", {0.1e-6}); }), DeviceErrorKind::refused);
}

// Harvard

class HarvardDouble : public testing::TestWithParam<Options> {};
TEST_P(HarvardDouble, KeepsTheContractAndInfuses) {
  const auto clock = wall_clock();
  DoubleProcess instrument("harvard_pump11", GetParam());
  const auto pump = scripted::open_instrument(on_double("harvard_pump11", instrument, *clock));
  EXPECT_EQ(contract::check(*pump), Findings{});
  EXPECT_NEAR(instrument.number("diameter_mm"), 14.43, 0.01);
  set(*pump, "rate", 1e-6 / 60);
  EXPECT_NEAR(number(*pump, "rate"), 1e-6 / 60, 1e-11);
  command(*pump, "infuse");
  EXPECT_TRUE(flag(*pump, "running"));
  const double before = instrument.number("plunger_ul");
  clock->sleep_for(500ms);
  EXPECT_GT(instrument.number("plunger_ul"), before + 5);
  command(*pump, "withdraw");
  const double turned = instrument.number("plunger_ul");
  clock->sleep_for(300ms);
  EXPECT_LT(instrument.number("plunger_ul"), turned);
  command(*pump, "stop");
  EXPECT_FALSE(flag(*pump, "running"));
}
INSTANTIATE_TEST_SUITE_P(Ways, HarvardDouble,
                         testing::Values(Options{}, Options{"late=0.1"},
                                         Options{"pieces=3", "gap=0.005"}),
                         [](const auto& made) { return name_of(made.param); });

// Temperature controllers

class ControllerDouble : public testing::TestWithParam<Options> {};
TEST_P(ControllerDouble, KeepsTheContractAndHoldsItsSetPoint) {
  const auto clock = wall_clock();
  DoubleProcess instrument("temperature_controller", GetParam());
  const bool pixsys = GetParam().front() == "model=atr142";
  auto heater = scripted::open_instrument(
      on_double(pixsys ? "pixsys_atr142" : "tc038d", instrument, *clock, {{"unit", 1.0}}));
  EXPECT_EQ(contract::check(*heater), Findings{});
  set(*heater, "set_point", 273.15 + 61.3);
  EXPECT_NEAR(number(*heater, "set_point"), 273.15 + 61.3, 1e-9);
  EXPECT_NEAR(instrument.number("setpoint"), 61.3, 1e-9);
  instrument.order(R"({"set": {"temperature": 44.4}})");
  EXPECT_NEAR(number(*heater, "temperature"), 273.15 + 44.4, 0.2);
  heater.reset();
  clock->sleep_for(200ms);
  EXPECT_NEAR(instrument.number("setpoint"), pixsys ? 0 : 20, 1e-9);
}
INSTANTIATE_TEST_SUITE_P(Ways, ControllerDouble,
                         testing::Values(Options{"model=tc038d"}, Options{"model=atr142"},
                                         Options{"model=tc038d", "late=0.2"},
                                         Options{"model=tc038d", "pieces=3", "gap=0.003"}),
                         [](const auto& made) { return name_of(made.param); });

// A late answer carries no mark of its question: it must not become the answer to the next one.
TEST(ControllerDouble, ALateAnswerIsNeverTakenForAnother) {
  const auto clock = wall_clock();
  DoubleProcess instrument("temperature_controller", {"model=tc038d"});
  const auto heater = scripted::open_instrument(on_double("tc038d", instrument, *clock));
  set(*heater, "set_point", 273.15 + 50);
  instrument.order(R"({"set": {"temperature": 30}})");
  instrument.order(R"({"mode": {"late": 1.3}})");
  EXPECT_EQ(kind_of([&] { number(*heater, "set_point"); }), DeviceErrorKind::timeout);
  instrument.order(R"({"mode": {"late": 0.0}})");
  for (int i = 0; i < 5; ++i) {
    try {
      EXPECT_LT(number(*heater, "temperature"), 273.15 + 40);
    } catch (const DeviceError&) {  // it may say that it is not sure
    }
    try {
      EXPECT_GT(number(*heater, "set_point"), 273.15 + 45);
    } catch (const DeviceError&) {
    }
  }
}

TEST(ControllerDouble, ALineThatComesBackIsUsedAgain) {
  const auto clock = wall_clock();
  DoubleProcess instrument("temperature_controller", {"model=tc038d"});
  const auto heater = scripted::open_instrument(on_double("tc038d", instrument, *clock));
  instrument.order(R"({"unplug": true})");
  EXPECT_EQ(kind_of([&] { number(*heater, "temperature"); }), DeviceErrorKind::lost);
  EXPECT_NE(kind_of([&] { number(*heater, "temperature"); }), DeviceErrorKind::timeout);
}

// Firmata

TEST(FirmataDouble, ItsSwitchSwitchesAndItsContactIsRead) {
  const auto clock = wall_clock();
  DoubleProcess instrument("firmata", {"boot=0.1"});
  auto board = scripted::open_instrument(
      on_double("arduino_firmata", instrument, *clock, {{"plays", std::string("instrument")}}));
  EXPECT_EQ(board->info().identity.name, "Firmata StandardFirmata.ino");
  EXPECT_EQ(contract::check(*board), Findings{});
  set(*board, "on", true);
  EXPECT_NE(order_after(*clock, instrument, R"({"get": "outputs"})").find("true"),
            std::string::npos)
      << order_after(*clock, instrument, R"({"get": "outputs"})");
  EXPECT_TRUE(flag(*board, "closed"));
  instrument.order(
      R"({"set": {"levels": [false, false, true, false, false, false, false, false, false, false, false, false, false, false, false, false, false, false, false, false]}})");
  EXPECT_FALSE(flag(*board, "closed"));
  board.reset();
  EXPECT_EQ(order_after(*clock, instrument, R"({"get": "outputs"})").find("true"),
            std::string::npos);
}

class FirmataDouble : public testing::TestWithParam<Options> {};
TEST_P(FirmataDouble, KeepsTheContract) {
  const auto clock = wall_clock();
  DoubleProcess instrument("firmata", GetParam());
  const auto board = scripted::open_instrument(on_double("arduino_firmata", instrument, *clock));
  EXPECT_EQ(contract::check(*board), Findings{});
}
INSTANTIATE_TEST_SUITE_P(Ways, FirmataDouble,
                         testing::Values(Options{}, Options{"chatty=True"}, Options{"protocol=2.8"},
                                         Options{"late=0.05"}),
                         [](const auto& made) { return name_of(made.param); });

// Supply

class SupplyDouble : public testing::TestWithParam<Options> {};
TEST_P(SupplyDouble, KeepsTheContractAndIsOffInTheEnd) {
  const auto clock = wall_clock();
  DoubleProcess instrument("scpi_supply", GetParam());
  auto supply = scripted::open_instrument(on_double("scpi_supply", instrument, *clock));
  EXPECT_EQ(contract::check(*supply), Findings{});
  set(*supply, "set_point", 5.0);
  set(*supply, "on", true);
  clock->sleep_for(200ms);
  EXPECT_NEAR(number(*supply, "voltage"), 5, 0.05);
  EXPECT_NEAR(number(*supply, "current"), 0.5, 0.05);
  supply.reset();
  EXPECT_EQ(order_after(*clock, instrument, R"({"get": "output"})"), R"({"output": false})");
  EXPECT_EQ(order_after(*clock, instrument, R"({"get": "errors"})"), R"({"errors": []})");
}
INSTANTIATE_TEST_SUITE_P(Ways, SupplyDouble,
                         testing::Values(Options{}, Options{"terminator=crlf"},
                                         Options{"late=0.05"}, Options{"header=True"}),
                         [](const auto& made) { return name_of(made.param); });

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
