// Contract suites of the roles, kept by instruments of a few lines of Lua and their emulators, as
// the drivers in C++ keep them.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/coil_amplifier.h"
#include "devices/contract/current_sensor.h"
#include "devices/contract/field_probe.h"
#include "devices/contract/instrument.h"
#include "devices/contract/lamp.h"
#include "devices/contract/lens_mover.h"
#include "devices/contract/stage.h"
#include "devices/scripted/emulator.h"
#include "tests/devices/scripted/bench.h"

#include <gtest/gtest.h>

#include <chrono>

namespace vitreo::scripted {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Findings = std::vector<std::string>;

/// A file's emulator, and the line to it.
struct Emulated {
  explicit Emulated(const std::string& file, Surroundings surroundings = {})
      : text(file),
        emulator(make_emulator(load("it.lua", file, unit_of), std::move(surroundings))) {}
  Opening opening() {
    return {load("it.lua", text, unit_of),
            link_to(emulator, memory_byte_link(*emulator, *clock, {.latency = 200us}, &faults)),
            "it", *clock};
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  std::string text;
  std::shared_ptr<Emulator> emulator;
  LinkFaults faults{};
};

/// One axis that is homed, in @unit@.
constexpr const char* kStage = R"lua(
local homed = false
local function number(io, question) return tonumber(io:ask(question)) end
return {
  title = "A stage", kind = "@kind@", link = { terminator = "\r\n", timeout = 0.2 },
  identity = { ask = "ID?", match = "^(STAGE),(.+)$", fields = { "name", "serial" } },
  axes = { { name = "@axis@", unit = "@unit@", travel = { 0, 25 }, max_speed = 5, speed = 2, resolution = 0.001 } },
  position = function(io) return { number(io, "POS?") } end,
  set_off = function(io, target, speed) io:ask(("GO %.4f %.4f"):format(target[1], speed)) end,
  moving = function(io) return io:ask("MOVING?") == "1" end,
  halt = function(io) io:ask("HALT") end,
  home = function(io) io:ask("HOME") end,
  homed = function(io) return io:ask("HOMED?") == "1" end,
  emulator = {
    answers = {
      ["ID?"] = "STAGE,17",
      ["POS?"] = function(e) return ("%.4f"):format(e:at("x")) end,
      ["MOVING?"] = function(e) return e:gliding("x") and "1" or "0" end,
      ["HALT"] = function(e) e:glide("x", e:at("x"), 1) return "OK" end,
      ["HOME"] = function(e) e.homed = true e:glide("x", 0, 5) return "OK" end,
      ["HOMED?"] = function(e) return e.homed and "1" or "0" end,
      { "^GO (%S+) (%S+)$", function(e, to, speed) e:glide("x", tonumber(to), tonumber(speed)) return "OK" end },
    },
    position = function(e) return e:at("x") end,
  },
}
)lua";

TEST(ScriptedRoles, AStageKeepsTheContract) {
  Emulated it(filled(kStage, {{"kind", "stage"}, {"axis", "x"}, {"unit", "mm"}}));
  const auto stage = open_stage(it.opening());
  contract::StageCheck how;
  how.home = true;
  how.way = 2e-3;
  how.measured = [&] { return *it.emulator->position(it.clock->now()); };
  EXPECT_EQ(contract::check(*stage, *it.clock, how), Findings{});
}

TEST(ScriptedRoles, ARotationStageKeepsTheContract) {
  Emulated it(filled(kStage, {{"kind", "rotation_stage"}, {"axis", "angle"}, {"unit", "deg"}}));
  const auto stage = open_rotation_stage(it.opening());
  contract::StageCheck how;
  how.home = true;
  how.way = 0.03;
  EXPECT_EQ(contract::check(*stage, *it.clock, how), Findings{});
}

TEST(ScriptedRoles, ALensMoverKeepsTheContract) {
  Emulated it(filled(kStage, {{"kind", "lens_mover"}, {"axis", "z"}, {"unit", "mm"}}));
  const auto mover = open_lens_mover(it.opening());
  EXPECT_EQ(contract::check(*mover), Findings{});
}

constexpr const char* kProbe = R"lua(
return {
  title = "A probe", kind = "field_probe", axis_count = 3, range = 1, unit = "T",
  link = { terminator = "\n", timeout = 0.2 }, identity = "*IDN?",
  measure = function(io)
    local field = {}
    for number in io:ask("FIELD?"):gmatch("[^,]+") do field[#field + 1] = tonumber(number) end
    return field
  end,
  emulator = {
    answers = {
      ["*IDN?"] = "Maker,Probe,1,2",
      ["FIELD?"] = function(e) return ("%.9f,%.9f,%.9f"):format(e.field[1], e.field[2], e.field[3]) end,
    },
  },
}
)lua";

TEST(ScriptedRoles, AFieldProbeKeepsTheContract) {
  const std::vector<double> field{1e-3, -2e-3, 3e-3};
  Emulated it(kProbe, {.field = [&](Time) { return field; }});
  const auto probe = open_field_probe(it.opening());
  contract::FieldProbeCheck how;
  how.really = [&] { return field; };
  EXPECT_EQ(contract::check(*probe, *it.clock, how), Findings{});
}

constexpr const char* kSensor = R"lua(
return {
  title = "A logger", kind = "current_sensor", coils = { 1, 3 }, unit = "mA",
  link = { terminator = "\n", timeout = 0.2 }, identity = "*IDN?",
  measure = function(io)
    local first, second = io:ask("READ?"):match("^(%S+) (%S+)$")
    return { tonumber(first), tonumber(second) }
  end,
  emulator = { answers = { ["*IDN?"] = "Maker,Logger,1,2", ["READ?"] = "1500 -250.5" } },
}
)lua";

TEST(ScriptedRoles, ACurrentSensorKeepsTheContract) {
  Emulated it(kSensor);
  const auto sensor = open_current_sensor(it.opening());
  contract::CurrentSensorCheck how;
  how.really = [] { return std::vector{1.5, -0.2505}; };
  how.tolerance = 1e-9;
  EXPECT_EQ(contract::check(*sensor, how), Findings{});
}

constexpr const char* kCoils = R"lua(
local function text(currents)
  local words = {}
  for i, current in ipairs(currents) do words[i] = ("%.6f"):format(current) end
  return table.concat(words, " ")
end
local function numbers(said)
  local list = {}
  for word in said:gmatch("%S+") do list[#list + 1] = tonumber(word) end
  return list
end
return {
  title = "An amplifier", kind = "coils", channels = 3, current_limit = 2, unit = "A",
  link = { terminator = "\n", timeout = 0.2 }, identity = "*IDN?",
  make_safe = function(io) if io:ask("ZERO") ~= "OK" then io:fail("refused", "not at zero") end end,
  set_currents = function(io, currents) @set@ io:ask("SET " .. text(currents)) end,
  measured_currents = function(io) @measure@ return numbers(io:ask("MEAS?")) end,
  rescue = { identify = { "*IDN?", "Maker,Amplifier" }, send = { "ZERO" }, check = { "MEAS?", "0.000000 0.000000 0.000000" } },
  emulator = {
    start = function(e) e.currents = { 0, 0, 0 } end,
    answers = {
      ["*IDN?"] = "Maker,Amplifier,1,2",
      ["ZERO"] = function(e) e.currents = { 0, 0, 0 } return "OK" end,
      ["MEAS?"] = function(e) return text(e.currents) end,
      { "^SET (.+)$", function(e, said) e.currents = numbers(said) return "OK" end },
    },
  },
}
)lua";

TEST(ScriptedRoles, ACoilAmplifierKeepsTheContract) {
  std::vector<double> flowing(3, 0);
  Emulated it(filled(kCoils, {}),
              {.drive = [&](Time, const std::vector<double>& currents) { flowing = currents; }});
  const auto coils = open_coils(it.opening());
  contract::CoilAmplifierCheck how;
  how.measured = [&] {
    it.clock->sleep_for(1ms);
    return flowing;
  };
  EXPECT_EQ(contract::check(*coils, how), Findings{});
  coils->set_currents(std::vector{1., 0.5, -1.});
  coils->make_safe();
  EXPECT_EQ(how.measured(), (std::vector<double>{0, 0, 0}));
}

// A current flows when the file fails: then there is none, and what is commanded says so.
TEST(ScriptedRoles, ACoilAmplifierWhoseFileFailsIsAtZero) {
  for (const char* place : {"set", "measure"}) {
    for (const char* body :
         {"if io:now() > 1 then while true do end end",
          "if io:now() > 1 then local t = {} while true do t[#t + 1] = { #t } end end",
          "if io:now() > 1 then return nothing.x end",
          "if io:now() > 1 then while true do pcall(io.ask, io, 'NOTHING') end end",
          "if io:now() > 1 then error({}) end"}) {
      std::vector<double> flowing(3, 0);
      Emulated it(
          filled(kCoils, {{place, body}}),
          {.drive = [&](Time, const std::vector<double>& currents) { flowing = currents; }});
      const auto coils = open_coils(it.opening());
      coils->set_currents(std::vector{1., 0.5, -1.});
      it.clock->sleep_for(1ms);
      ASSERT_EQ(flowing, (std::vector<double>{1, 0.5, -1}));
      it.clock->sleep_for(2s);
      try {
        coils->measured_currents();
        coils->set_currents(std::vector{1.1, 0.5, -1.});
        ADD_FAILURE() << "no error: " << body;
      } catch (const DeviceError& error) {
        EXPECT_NE(std::string(error.what()).find("its driver failed: it.lua:"), std::string::npos)
            << error.what();
      }
      it.clock->sleep_for(1ms);
      EXPECT_EQ(flowing, (std::vector<double>{0, 0, 0})) << body;
      EXPECT_EQ(coils->currents(), (std::vector<double>{0, 0, 0}));
      EXPECT_THROW(coils->set_currents(std::vector{1., 1., 1.}), DeviceError);
    }
  }
}

// Each set point takes 80 ms: meanwhile the answer is owed, and the watch sees it. A cable that is
// pulled is seen without a question.
TEST(ScriptedRoles, AnAmplifiersLinkSaysWhatItOwesAndWhenItIsGone) {
  Emulated it(filled(kCoils, {}));
  const auto coils = open_coils(it.opening());
  EXPECT_EQ(coils->link_state().owed, Time::zero());
  EXPECT_EQ(coils->link_state().hung_up, "");
  it.faults.late = 80ms;
  const auto setting = it.clock->spawn("setting", [&] {
    coils->set_currents(std::vector{1., 0.5, -1.});
  });
  it.clock->sleep_for(50ms);
  EXPECT_GT(coils->link_state().owed, 40ms);
  EXPECT_LE(coils->link_state().owed, 50ms);
  setting->join();
  EXPECT_EQ(coils->link_state().owed, Time::zero());
  it.faults = {};
  it.faults.silent = true;
  EXPECT_THROW(coils->measured_currents(), DeviceError);
  it.clock->sleep_for(1s);
  EXPECT_GT(coils->link_state().owed, 1s) << "given up, and owed all the same";
  it.faults = {};
  it.faults.unplugged = true;
  EXPECT_NE(coils->link_state().hung_up, "");
}

constexpr const char* kLamp = R"lua(
return {
  title = "A lamp", kind = "lamp", link = { terminator = "\n", timeout = 0.2 }, identity = "*IDN?",
  make_safe = "LEVEL 0",
  set_level = function(io, level) io:send(("LEVEL %.3f"):format(level)) end,
  emulator = { answers = { ["*IDN?"] = "Maker,Lamp,1,2", { "^LEVEL (.+)$", function(e, level) e.level = level end } } },
}
)lua";

TEST(ScriptedRoles, ALampKeepsTheContract) {
  Emulated it(kLamp);
  const auto lamp = open_lamp(it.opening());
  EXPECT_EQ(contract::check(*lamp), Findings{});
}

constexpr const char* kHeater = R"lua(
return {
  title = "A heater", kind = "actuator", measures = "temperature", link = { timeout = 0.2 }, identity = "*IDN?",
  make_safe = "OFF",
  properties = {
    set_point = { ask = "SP?", set = "SP %.2f", unit = "degC", min = 0, max = 80 },
    value = { ask = "T?", unit = "degC", every = 0.1 },
  },
  emulator = {
    start = function(e) e.set_point = 20 end,
    answers = {
      ["*IDN?"] = "Maker,Heater,1,2", ["OFF"] = function() end, ["T?"] = "21.5",
      ["SP?"] = function(e) return ("%.2f"):format(e.set_point) end,
      { "^SP (.+)$", function(e, to) e.set_point = tonumber(to) end },
    },
  },
}
)lua";

TEST(ScriptedRoles, AFreeInstrumentKeepsTheContract) {
  Emulated it(kHeater);
  const auto heater = open_instrument(it.opening());
  EXPECT_EQ(contract::check(*heater), Findings{});
  it.clock->sleep_for(1s);
  EXPECT_DOUBLE_EQ(std::get<double>(heater->latest(1).sample->value), 294.65);
}

// ---------------------------------------------------------------- faults of the emulated link

TEST(ScriptedRoles, FaultsOfTheLinkAreFeltAndOver) {
  Emulated it(kHeater);
  const auto heater = open_instrument(it.opening());
  const auto kind_of = [&]() -> std::string {
    try {
      heater->read(1, 1s);
      return "none";
    } catch (const DeviceError& error) {
      return to_string(error.kind);
    }
  };
  it.faults.silent = true;
  EXPECT_EQ(kind_of(), "timeout");
  it.faults.silent = false;
  EXPECT_EQ(kind_of(), "none");
  it.faults.deaf = true;
  EXPECT_EQ(kind_of(), "timeout");
  it.faults.deaf = false;
  EXPECT_EQ(kind_of(), "none");
  it.faults.keep = 2;
  EXPECT_EQ(kind_of(), "timeout");
  it.faults.keep = -1;
  EXPECT_EQ(kind_of(), "none");
  it.faults.unplugged = true;
  EXPECT_EQ(kind_of(), "lost");
  it.faults.unplugged = false;
  EXPECT_EQ(kind_of(), "none");
  it.faults.late = 5s;
  EXPECT_EQ(kind_of(), "timeout");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::scripted
