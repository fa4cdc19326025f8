// Instruments in Lua at the prompt: their files are read anew while handles are held; and the call
// that gives a script the instrument of a kind.
// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/laboratory.h"
#include "devices/time/error.h"
#include "host/lua/engine/engine.h"
#include "host/rig/open_rig.h"
#include "host/session/session.h"
#include "host/terminal/line_editor.h"
#include "tests/host/lua/interpreter/lua_bench.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <fstream>
#include <map>
#include <sstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

/// A heater of which a test says another version each time that it is read anew.
constexpr const char* kHeater = R"lua(
local set = settings { highest = { default = 60, unit = "degC" } }
return {
  title = "A heater", kind = "actuator", measures = "temperature",
  link = { timeout = 0.2 }, identity = { ask = "ID?", match = "^HEATER (%d)", fields = { "serial" } },
  make_safe = { on = false },
  properties = {
    set_point = { unit = "degC", ask = "SP?", set = "SP %.1f", min = 0, max = set.highest },
    on = { type = "flag", ask = "ON?", set = function(io, on) io:send(on and "ON 1" or "ON 0") end },
    @property@
  },
  commands = {
    soak = { send = "SOAK", done = function(io) return io:ask("SOAKED?") == "1" end, lasts = 20 },
  },
  emulator = {
    start = function(e) e.set_point, e.on = @set_point@, "0" end,
    answers = {
      ["ID?"] = "@identity@ 1", ["ON?"] = function(e) return e.on end,
      ["SP?"] = function(e) return ("%.1f"):format(e.set_point) end,
      ["SOAKED?"] = function(e) return e.soaked and e.now > e.soaked + 5 and "1" or "0" end,
      ["P?"] = "12",
      { "^SP (.+)$", function(e, value) e.set_point = tonumber(value) end },
      { "^ON ([01])$", function(e, on) e.on = on end },
      { "^SOAK$", function(e) e.soaked = e.now end },
    },
  },
}
)lua";

std::string heater(std::map<std::string, std::string> with = {}) {
  std::string text = kHeater;
  for (const auto& [name, usual] : std::map<std::string, std::string>{
           {"property", ""}, {"set_point", "20"}, {"identity", "HEATER"}}) {
    const std::string mark = "@" + name + "@";
    text.replace(text.find(mark), mark.size(), with.contains(name) ? with[name] : usual);
  }
  return text;
}

constexpr const char* kPower =
    R"(power = { unit = "W", ask = "P?", every = 1, help = "of its coil" },
    mode = { choices = { slow = "1", fast = "2" }, set = "MODE %s" },)";

constexpr const char* kAmplifier = R"lua(
return {
  title = "An amplifier", kind = "coils", channels = @channels@, current_limit = 2, unit = "A",
  link = { timeout = 0.2 }, identity = "*IDN?",
  make_safe = function(io) io:ask("ZERO") end,
  set_currents = function(io, currents) io:ask("SET") end,
  emulator = { answers = { ["*IDN?"] = "Maker,Amplifier,@serial@,2", ZERO = "OK", SET = "OK" } },
}
)lua";
std::string amplifier(const std::string& channels, const std::string& serial) {
  std::string text = kAmplifier;
  text.replace(text.find("@channels@"), 10, channels);
  text.replace(text.find("@serial@"), 8, serial);
  return text;
}

constexpr const char* kProbe = R"lua(
return {
  title = "A probe", kind = "sensor", measures = "field", link = {}, identity = "*IDN?",
  properties = { value = { ask = function(io) io:sleep(3) return 1 end } },
  emulator = { answers = { ["*IDN?"] = "M,P,1,2" } },
}
)lua";

/// Lines of a list; one that begins with "?" asks what could follow instead.
class Typed final : public LineEditor {
 public:
  Typed(const std::string& lines, std::ostream& out) : out_(out) {
    std::istringstream in(lines);
    for (std::string line; std::getline(in, line);) lines_.push_back(line);
  }
  Read read(const std::string&, std::string& line, const std::function<bool()>&) override {
    for (; !lines_.empty(); lines_.pop_front()) {
      if (!lines_.front().starts_with("?")) {
        line = lines_.front();
        lines_.pop_front();
        return Read::line;
      }
      for (const std::string& word : complete_(lines_.front().substr(1), lines_.front().size() - 1))
        out_ << word << " ";
      out_ << "\n";
    }
    return Read::end;
  }
  void remember(const std::string&) override {}
  void set_completion(Complete complete) override { complete_ = std::move(complete); }
  bool interactive() const override { return false; }
  bool show_above(const std::string&) override { return false; }

 private:
  std::ostream& out_;
  std::deque<std::string> lines_;
  Complete complete_;
};

/// What is open on it begins when the rig is opened; `next` are the versions of heater.lua, one a
/// reload.
class Reload : public testing::Test {
 protected:
  void open(const std::string& rig) {
    session.reset();
    opened.reset();
    write("rig.lua", rig);
    opened = open_rig(engine->load_rig(path("rig.lua")), *clock, 1);
    opened->rig().reload = [this, reload = opened->rig().reload](const std::string& role) {
      if (!next.empty()) {
        write(role + ".lua", next.front());
        next.pop_front();
      }
      return reload(role);
    };
    recorder = std::make_unique<Recorder>(folder.path(), start_of_test(1));
    session = std::make_unique<Session>(*clock, opened->rig(), *recorder, listener, 7);
  }
  void open_heater() {
    write("heater.lua", heater());
    open("return { title = 'r', heater = { driver = 'heater', highest = 273.15 + 45 } }");
  }
  std::string prompt(const std::string& lines) {
    std::ostringstream out;
    Typed typed(lines, out);
    try {
      engine->prompt(*session, typed, out, out);
    } catch (const ScriptError&) {  // some statement failed: `out` says which
    }
    return out.str();
  }
  std::string path(const std::string& name) const { return (folder.path() / name).string(); }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(path(name)) << text;
  }
  std::vector<std::string> events(const std::string& kind) const {
    std::vector<std::string> texts;
    for (const Event& one : recorder->events())
      if (one.kind == kind) texts.push_back(one.text);
    return texts;
  }

  TemporaryFolder folder;
  std::unique_ptr<Clock> clock = virtual_clock();
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({});
  std::unique_ptr<OpenRig> opened;
  SilentListener listener;
  std::unique_ptr<Recorder> recorder;
  std::unique_ptr<Session> session;
  std::deque<std::string> next;
};

TEST_F(Reload, AHandleThatIsHeldFollowsTheNewDeclaration) {
  open_heater();
  next = {heater({{"property", kPower}, {"set_point", "30"}})};
  const std::string said = prompt(
      "h = rig.heater\nh:power()\n?h:po\nrig:reload('heater')\nh:power()\n?h:po\n"
      "h == rig.heater\nh:set_point() - 273.15\nh:power?\n?h:set_mode('f\nh:set_mode('warm')\n");
  expect_all(said, {"rig.heater has no power",
                    "\n\n\"heater: A heater, serial 1, actuator of temperature\"\n",
                    "\n12 W\nh:power \ntrue\n30.0\n", "rig.heater:power()", "of its coil",
                    "\nfast \n", "mode: wants fast or slow"});
}

TEST_F(Reload, ABrokenFileIsToldByItsLineAndChangesNothing) {
  open_heater();
  next = {"return {\n  title = 'A heater',\n  kind = = 'actuator' }",
          "return { title = 'A heater',\n  kind = 'heatr' }",
          heater({{"property", "speed = { set = 'S %d' },"}}), "error('not today')"};
  const std::string said = prompt(
      "rig.heater:set_set_point(273.15 + 33)\nrig.heater:make_safe()\n"
      "rig:reload('heater')\nrig:reload('heater')\nrig:reload('heater')\nrig:reload('heater')\n"
      "rig.heater:set_point() - 273.15\n");
  expect_all(said, {"heater.lua:3: unexpected symbol", "kind: must be one of",
                    "properties.speed.max: a number that can be set has bounds",
                    "heater.lua:1: not today"});
  EXPECT_TRUE(said.ends_with("\n33.0\n")) << "its link and its emulator are untouched: " << said;
  EXPECT_EQ(events("reload").size(), 4U);
}

TEST_F(Reload, AnInstrumentThatIsNotTheOneWantedIsRefusedAndTheOldOneComesBack) {
  open_heater();
  next = {heater({{"identity", "COOLER"}})};
  const std::string said = prompt("rig:reload('heater')\nrig.heater:set_point() - 273.15\n");
  expect_all(said,
             {"this is no A heater: COOLER 1", "as it was before it is open again", "\n20.0\n"});
}

TEST_F(Reload, SettingsOfTheRigFileHoldForTheNewFile) {
  open_heater();
  std::string other = heater();
  other.replace(other.find("highest"), 7, "topmost");
  other.replace(other.find("set.highest"), 11, "60");
  next = {heater(), other};
  const std::string said =
      prompt("rig:reload('heater')\nrig.heater:set_set_point(273.15 + 50)\nrig:reload('heater')\n");
  expect_all(said, {"set_point: wants 0 to 45", "heater.highest is not known"});
}

TEST_F(Reload, WhatMayBeOnIsMadeSafeByAPersonFirst) {
  open_heater();
  const std::string said = prompt(
      "rig.heater:set_on(true)\nrig:reload('heater')\nrig.heater:on()\nrig.heater:make_safe()\n"
      "rig:reload('heater')\n");
  expect_all(said, {"it may be on, or moves", "rig.heater:make_safe()", "\ntrue\n",
                    "\"heater: A heater, serial 1, actuator of temperature\"\n"});
}

TEST_F(Reload, NothingIsExchangedDuringACall) {
  open_heater();
  const std::string said = prompt(
      "run:together(function() rig.heater:soak() end, function() run:wait(1) "
      "print(pcall(rig.reload, rig, 'heater')) end)\n");
  EXPECT_NE(said.find("it may be on"), std::string::npos) << said;
  // A sensor has no safe state that would be asked for before.
  write("probe.lua", kProbe);
  open("return { title = 'r', probe = { driver = 'probe' } }");
  EXPECT_NE(prompt("run:together(function() print(rig.probe:value()) end, function() run:wait(1) "
                   "print(pcall(rig.reload, rig, 'probe')) end)\n")
                .find("it is at work: wait until that has ended"),
            std::string::npos);
}

TEST_F(Reload, AFunctionThatWasTakenFromTheOldOneIsRefused) {
  open_heater();
  expect_all(prompt("f = rig.heater.set_point\nrig:reload('heater')\nf(rig.heater)\n"),
             {"is of rig.heater as it was before a reload"});
}

TEST_F(Reload, IsForThePromptAlone) {
  open_heater();
  write("p.lua", "return { title = 'p', run = function(rig, p, run) rig:reload('heater') end }");
  const ProtocolDescription protocol = engine->describe(path("p.lua"));
  try {
    engine->run(protocol, {}, *session);
    FAIL() << "nothing was thrown";
  } catch (const ScriptError& error) {
    EXPECT_NE(std::string(error.what()).find("is for the prompt"), std::string::npos)
        << error.what();
  }
}

TEST_F(Reload, OtherRolesAreToldApart) {
  open_heater();
  expect_all(prompt("rig:reload('heatre')\n"),
             {"there is no heatre in this rig; such are: heater"});
}

TEST_F(Reload, TheRecordGoesOnAndKeepsTheNewText) {
  write("heater.lua", heater({{"property", kPower}}));
  open("return { title = 'r', heater = { driver = 'heater' } }");
  std::string renamed = heater({{"property", kPower}});
  renamed.replace(renamed.find("\"P?\"] = \"12\""), 12, "\"P?\"] = \"13\"");
  next = {renamed};
  prompt("run:wait(3.5)\nrig:reload('heater')\nrun:wait(3.5)\n");
  const Stream* const power = recorder->stream("heater_power");
  ASSERT_NE(power, nullptr);
  EXPECT_EQ(power->values.front(), 12);
  EXPECT_EQ(power->values.back(), 13);
  EXPECT_EQ(std::count(power->values.begin(), power->values.end(), 13), 4);
  ASSERT_EQ(recorder->data().modules.size(), 1U);
  EXPECT_EQ(recorder->data().modules[0].text, renamed);
  EXPECT_EQ(events("reload"), std::vector<std::string>{"heater is read anew: heater reloaded 1"});
}

TEST_F(Reload, CoilsWaitForTheirCurrentAndForTheServoLoop) {
  write("coils.lua", amplifier("8", "S1"));
  open("return { title = 'r', coils = { driver = 'coils.lua', guardian = false } }");
  Rig& rig = opened->rig();
  const auto refusal = [&]() -> std::string {
    try {
      session->reload("coils");
      return "";
    } catch (const DeviceError& error) {
      return error.what();
    }
  };
  rig.coils->set_currents(std::vector<double>(8, 0.01));
  EXPECT_NE(refusal().find("the coils carry a current"), std::string::npos) << refusal();
  rig.coils->make_safe();
  {
    const Interlock::Heartbeat loop(*rig.coils, "the servo loop");
    EXPECT_NE(refusal().find("a servo loop uses the rig"), std::string::npos) << refusal();
  }
  EXPECT_NE(rig.coils->identity().find("S1"), std::string::npos) << rig.coils->identity();
  write("coils.lua", amplifier("8", "S2"));
  EXPECT_EQ(refusal(), "");
  EXPECT_NE(rig.coils->identity().find("S2"), std::string::npos) << rig.coils->identity();
  write("coils.lua", amplifier("6", "S3"));
  const std::string channels = refusal();
  EXPECT_NE(channels.find("channels are others: that takes a rig that is opened anew"),
            std::string::npos)
      << channels;
  EXPECT_EQ(rig.coils->channels(), 8);
  rig.coils->enable();
  rig.coils->set_currents(std::vector<double>(8, 0.01));
}

// Silence

/// A thermometer that says nothing from 3 s to 8 s; `more` stands in its table.
std::string thermometer(const std::string& more, const std::string& ask = "\"T?\"") {
  return "return { title = 'A thermometer', kind = 'sensor', measures = 'temperature', " + more +
         R"( link = { timeout = 0.2 }, identity = '*IDN?',
  properties = { value = { ask = )" +
         ask + R"(, every = 0.5 } },
  emulator = { answers = {
    ['*IDN?'] = 'M,T,1,2', ['T?'] = function(e) if e.now < 3 or e.now > 8 then return '21' end end,
  } } })";
}

TEST_F(Reload, ASilentInstrumentIsAnAlarmUntilItIsHeardAgain) {
  write("bath.lua", thermometer(""));
  open("return { title = 'r', bath = { driver = 'bath' } }");
  prompt("run:wait(3.9)\n");
  EXPECT_EQ(events("instrument").size(), 1U) << "one missed answer is an event";
  EXPECT_NE(events("instrument")[0].find("bath.value cannot be asked: emulated says nothing"),
            std::string::npos)
      << events("instrument")[0];
  EXPECT_TRUE(session->alarms.shown().empty());
  prompt("run:wait(3)\n");
  ASSERT_EQ(session->alarms.shown().size(), 1U);
  const Alarm alarm = session->alarms.shown()[0];
  EXPECT_EQ(alarm.name, "bath.value");
  EXPECT_EQ(alarm.priority, AlarmPriority::medium);
  EXPECT_TRUE(alarm.active);
  EXPECT_EQ(events("alarm").size(), 1U) << "told once";
  prompt("run:wait(3)\n");
  EXPECT_FALSE(session->alarms.shown()[0].active);
  EXPECT_EQ(events("alarm cleared").size(), 1U);
  EXPECT_EQ(events("instrument").back(), "bath.value is heard again");
  EXPECT_EQ(session->control.tier(), StopTier::none);
}

TEST_F(Reload, WhatTheFileDeclaresOfItsSilenceIsDone) {
  const std::pair<const char*, StopTier> ways[] = {{"on_silence = 'note',", StopTier::none},
                                                   {"on_silence = 'alarm',", StopTier::none},
                                                   {"on_silence = 'stop',", StopTier::stop},
                                                   {"on_silence = 'abort',", StopTier::abort}};
  for (const auto& [way, tier] : ways) {
    session.reset();
    opened.reset();
    clock = virtual_clock();
    write("bath.lua", thermometer(way));
    open("return { title = 'r', bath = { driver = 'bath' } }");
    clock->sleep_for(from_seconds(6));
    EXPECT_EQ(session->control.tier(), tier) << way;
    EXPECT_EQ(events("alarm").empty(), std::string(way).find("note") != std::string::npos) << way;
    if (tier == StopTier::none) continue;
    EXPECT_NE(session->control.reason().find("because bath.value cannot be asked"),
              std::string::npos)
        << session->control.reason();
    EXPECT_EQ(session->alarms.shown()[0].priority, AlarmPriority::high);
  }
}

TEST_F(Reload, AFileThatFailsIsInTheRecordByItsLine) {
  write(
      "bath.lua",
      thermometer("", "function(io)\n if io:now() > 3 then local a = nil + 1 end\n return 1 end"));
  open("return { title = 'r', bath = { driver = 'bath' } }");
  prompt("run:wait(6)\n");
  ASSERT_EQ(events("alarm").size(), 1U);
  for (const std::string kind : {"instrument", "alarm"})
    EXPECT_NE(events(kind)[0].find("bath.lua:3: attempt to perform arithmetic on a nil value"),
              std::string::npos)
        << events(kind)[0];
}

// At a run's end

TEST_F(Reload, WhatHasNoSafeStateMayBeGoneAtTheEnd) {
  write("bath.lua", thermometer(""));
  write("heater.lua", heater());
  open("return { title = 'r', bath = { driver = 'bath' }, heater = { driver = 'heater' } }");
  sim::Laboratory* const world = opened->laboratory();
  ASSERT_NE(world, nullptr);
  world->faults().links["bath"].unplugged = true;
  clock->sleep_for(from_seconds(1));
  EXPECT_EQ(opened->make_safe(), std::vector<std::string>{});
  world->faults().links["heater"].unplugged = true;
  const std::vector<std::string> failures = opened->make_safe();
  ASSERT_EQ(failures.size(), 1U) << "that it is off nobody knows";
  EXPECT_NE(failures[0].find("heater"), std::string::npos);
  world->faults().links["heater"].unplugged = false;
}

// The instrument of a kind

TEST_F(Reload, AScriptIsGivenTheInstrumentOfAKind) {
  write("heater.lua", heater());
  write("probe.lua", kProbe);
  open(
      "return { title = 'r', bath = { driver = 'probe' }, room = { driver = 'heater' }, "
      "hall = { driver = 'heater' } }");
  const std::string said = prompt(
      "rig:instrument('sensor:field') == rig.bath\nrig:instrument('room') == rig.room\n"
      "rig:instrument('pump')\nrig:instrument('actuator')\n");
  expect_all(said, {"true\ntrue\n", "this rig has no pump, only bath, hall, room",
                    "several are of the kind actuator: hall, room; name one of them"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
