// The program with instruments of Lua files: broken ones beside energized coils, faults of their
// links, their emulators offered, and records that keep their texts.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kAmplifier = R"lua(
local function numbers(said)
  local list = {}
  for word in said:gmatch("%S+") do list[#list + 1] = tonumber(word) end
  return list
end
return {
  title = "An amplifier", kind = "coils", channels = 8, current_limit = 2, unit = "A",
  link = { terminator = "\n", timeout = 0.2 }, identity = "*IDN?",
  make_safe = function(io) io:ask("ZERO") end,
  set_currents = function(io, currents)
    if currents[1] > 1 then while true do end end
    io:ask(("SET" .. (" %.3f"):rep(8)):format(table.unpack(currents)))
  end,
  measured_currents = function(io) return numbers(io:ask("MEAS?")) end,
  emulator = {
    start = function(e) e.currents = { 0, 0, 0, 0, 0, 0, 0, 0 } end,
    answers = {
      ["*IDN?"] = "Maker,Amplifier,1,2",
      ["ZERO"] = function(e) e.currents = { 0, 0, 0, 0, 0, 0, 0, 0 } return "OK" end,
      ["MEAS?"] = function(e) return table.concat(e.currents, " ") end,
      { "^SET (.+)$", function(e, said) e.currents = numbers(said) return "OK" end },
    },
  },
}
)lua";

constexpr const char* kThermometer = R"lua(
local set = settings { fails_after = { default = 1000, unit = "s" } }
return {
  title = "A thermometer", kind = "sensor", measures = "temperature",
  link = { timeout = 0.2 }, identity = "*IDN?",
  properties = {
    value = {
      ask = function(io)
        if io:now() > set.fails_after then while true do end end
        return tonumber(io:ask("T?"))
      end,
      every = 0.1,
    },
  },
  emulator = { answers = { ["*IDN?"] = "Maker,Thermometer,1,2", ["T?"] = "21.5" } },
}
)lua";

/// Holds currents, and says what it reads of both; @first@ A at last.
std::string protocol(const std::string& first) {
  return R"lua(return { title = "Holds", needs = { "coils" }, parameters = {},
  run = function(rig, p, run)
    rig.coils:set_currents({ 0.5, 0, -0.5, 0, 0, 0, 0, 0 })
    run:wait(4)
    local good, value = pcall(rig.thermometer.value, rig.thermometer)
    print("READ " .. tostring(value))
    print("HELD " .. rig.coils:currents()[1])
    rig.coils:set_currents({ )lua" +
         first + R"lua(, 0, -0.5, 0, 0, 0, 0, 0 })
    run:wait(1)
    print("THE END")
  end }
)lua";
}

class InstrumentFiles : public testing::Test {
 protected:
  InstrumentFiles() {
    place.write("amplifier.lua", kAmplifier);
    place.write("thermometer.lua", kThermometer);
    rig("");
    place.write("p.lua", protocol("0.6"));
    place.write("offered.lua",
                "return { title = 'bench', coils = { driver = 'amplifier', address = "
                "'serial:/dev/ttyUSB7', guardian = false }, thermometer = { driver = "
                "'thermometer', address = 'serial:/dev/ttyUSB8' } }");
  }
  void rig(const std::string& settings) const {
    place.write(
        "rig.lua",
        "return { title = 'bench', coils = { driver = 'amplifier' }, thermometer = { driver "
        "= 'thermometer'" +
            settings + " } }");
  }
  Spoken run(const std::string& more = "") const {
    return place.vitreo("run p.lua --rig rig.lua --out runs " + more);
  }
  /// Of the one run.
  std::filesystem::path record() const {
    return std::filesystem::directory_iterator(place.folder() / "runs")->path();
  }
  Workplace place;
};

bool says(const std::string& text, const std::string& words) {
  return text.find(words) != std::string::npos;
}

TEST_F(InstrumentFiles, AThermometerThatFailsIsToldAndTheCoilsHold) {
  rig(", fails_after = 2");
  const Spoken spoken = run("--trace-links");
  EXPECT_EQ(spoken.exit_code, 0) << spoken.err;
  EXPECT_TRUE(says(spoken.err, "thermometer.lua:") && says(spoken.err, "it works for too long"))
      << spoken.out << spoken.err;
  EXPECT_TRUE(says(spoken.err, "HELD 0.5") && says(spoken.err, "THE END")) << spoken.out;
}

TEST_F(InstrumentFiles, AnAmplifierThatFailsEndsTheRunWithItsCoilsAtZero) {
  place.write("p.lua", protocol("1.5"));
  const Spoken spoken = run("--trace-links");
  EXPECT_EQ(spoken.exit_code, 4) << spoken.err;
  const std::string said = spoken.out + spoken.err;
  EXPECT_TRUE(says(said, "its driver failed: amplifier.lua:") && says(said, "works for too long"))
      << spoken.err;
  EXPECT_FALSE(says(spoken.err, "THE END"));
  const std::string bytes = place.vitreo("show '" + record().string() + "' --links").out;
  const std::size_t zero = bytes.rfind("ZERO"), set = bytes.rfind("SET ");
  ASSERT_NE(set, std::string::npos) << bytes;
  EXPECT_TRUE(zero != std::string::npos && zero > set) << bytes;
}

TEST_F(InstrumentFiles, FaultsReachTheirLinksAndTheTraceHasTheirBytes) {
  for (const auto& [fault, words] : std::vector<std::pair<std::string, std::string>>{
           {"silent", "says nothing to"}, {"unplugged", "lost"}, {"short", "says nothing to"}}) {
    const Spoken spoken = run("--trace-links --fault thermometer:" + fault + ":after=2s");
    // One that is still gone at the end has nothing to be made safe: the run was completed.
    EXPECT_EQ(spoken.exit_code, 0) << fault << spoken.err;
    EXPECT_TRUE(says(spoken.err, words)) << fault << ": " << spoken.out << spoken.err;
    EXPECT_TRUE(says(spoken.err, "ALARM medium: thermometer.value: ")) << fault << spoken.err;
    const std::string bytes = place.vitreo("show '" + record().string() + "' --links").out;
    EXPECT_TRUE(says(bytes, "thermometer") && says(bytes, "T?\\x0A")) << bytes;
    std::filesystem::remove_all(place.folder() / "runs");
  }
}

constexpr const char* kHeater = R"lua(
return {
  title = "A heater", kind = "actuator", link = { timeout = 0.2 }, identity = "*IDN?", make_safe = "OFF",
  properties = { set_point = { set = "SP %.1f", min = 0, max = 90, ask = "SP?", @every@ } },
  emulator = { answers = { ["*IDN?"] = "Maker,Heater,1,2", ["SP?"] = "20" } },
}
)lua";

TEST_F(InstrumentFiles, ARunWhoseHeaterIsGoneSaysWhatItDidAndWhatIsNotKnown) {
  place.write("p.lua",
              "return { title = 'Heats', needs = { 'heater' }, run = function(rig, p, run)\n"
              "run:wait(8)\nprint('THE END')\nend }");
  const auto heated = [&](const std::string& every) {
    std::string text = kHeater;
    text.replace(text.find("@every@"), 7, every);
    place.write("heater.lua", text);
    place.write("rig.lua", "return { title = 'bench', heater = { driver = 'heater' } }");
    return run("--fault heater:unplugged:after=2s");
  };
  // Not asked by itself, it is missed at the end only.
  const Spoken unasked = heated("");
  EXPECT_EQ(unasked.exit_code, 4) << unasked.err;
  EXPECT_TRUE(says(unasked.err, "THE END"));
  const std::string said = unasked.out + unasked.err;
  EXPECT_TRUE(says(said, "came to its end, but could not be made safe: heater")) << said;
  // Asked by itself, it ends the run.
  const Spoken asked = heated("every = 0.5");
  EXPECT_FALSE(says(asked.err, "THE END")) << asked.err;
  EXPECT_TRUE(says(asked.err, "ALARM high: heater.set_point: ")) << asked.err;
  const std::string told = asked.out + asked.err;
  EXPECT_TRUE(says(told, "because heater.set_point cannot be asked")) << told;
}

TEST_F(InstrumentFiles, EmulateOffersThem) {
  place.write("ask.py", R"py(
import os, sys, time, tty
where = open("offered").read()
line = [l for l in where.splitlines() if l.startswith("thermometer: serial:")][0]
port = os.open(line.split("serial:")[1].split(",")[0], os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
os.write(port, b"*IDN?\nT?\n")
time.sleep(1)
print(os.read(port, 100))
)py");
  const std::string command =
      "cd '" + place.folder().string() +
      "' && ('" VITREO_PROGRAM
      "' emulate offered.lua >offered 2>told </dev/null & echo $! >pid; for i in $(seq 100); do "
      "grep "
      "-q "
      "'^thermometer: ' offered && grep -q '^coils: ' offered && break; sleep 0.1; done; python3 "
      "ask.py >said 2>&1; kill -INT $(cat pid))";
  ASSERT_EQ(std::system(command.c_str()), 0) << place.read("told");
  EXPECT_TRUE(says(place.read("said"), "Maker,Thermometer,1,2\\n21.5\\n"))
      << place.read("said") << place.read("offered") << place.read("told");
}

constexpr const char* kServo =
    R"lua(return { title = "Holds", needs = { "coils", "top_camera", "sample" }, parameters = {},
  run = function(rig, p, run)
    rig.sample:remove_robot()
    local servo <close> = rig:servo { background = rig:learn_background { frames = 4 } }
    servo:hold(vector(0, 0, 0))
    rig.sample:insert_robot(vector(0, 0, 0))
    run:wait(0.5)
  end }
)lua";

TEST_F(InstrumentFiles, TheRecordHasTheirTextsAndIsReadWithoutThem) {
  place.write("p.lua", kServo);
  place.write(
      "rig.lua",
      "return { base = 'simulated', title = 'x', thermometer = { driver = 'thermometer' } }");
  const Spoken ran = run("--frames top_camera");
  ASSERT_EQ(ran.exit_code, 0) << ran.err;
  const std::string folder = record().string();
  const std::string kept = "runs/" + record().filename().string() + "/script/";
  EXPECT_EQ(place.read(kept + "thermometer.lua"), kThermometer);
  const std::string shown = place.vitreo("show '" + folder + "' --json").out;
  EXPECT_TRUE(says(shown, "\"thermometer.lua\":\"")) << "no SHA-256 of it";
  const Spoken replayed = place.vitreo("replay '" + folder + "'");
  EXPECT_EQ(replayed.exit_code, 0) << replayed.err;
  for (const char* file : {"amplifier.lua", "thermometer.lua", "rig.lua", "p.lua"})
    std::filesystem::remove(place.folder() / file);
  EXPECT_EQ(place.vitreo("show '" + folder + "' --json").out, shown);
  const Spoken again = place.vitreo("replay '" + folder + "'");
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(again.out, replayed.out);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
