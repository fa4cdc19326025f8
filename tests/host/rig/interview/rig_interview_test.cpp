// Interview that makes a rig file, with a machine that is made up.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/rig_interview.h"

#include "devices/time/error.h"
#include "host/lua/engine/library.h"
#include "host/lua/script/reading.h"
#include "host/rig/interview/setting_texts.h"
#include "host/rig/rig_settings.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <set>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Kind = InterviewReply::Kind;
using Answers = std::map<std::string, std::string>;

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

FoundInstrument found(const std::string& driver, const std::string& address,
                      std::vector<ProposedRole> roles, int baud_rate = 0) {
  return {driver, address, baud_rate, "a " + driver, std::move(roles)};
}

/// A machine on which nothing is plugged in, until a test says so.
struct NewRig : ::testing::Test {
  std::map<std::string, std::vector<FoundInstrument>> there;  // by address
  std::vector<std::string> asked;
  InterviewWorld world;
  std::string checked;  // the text of the last whole file

  NewRig() {
    world.plan = plan_for_address;
    world.ask = [this](const std::string& address) {
      asked.push_back(address);
      if (!there.contains(address))
        throw DeviceError(DeviceErrorKind::not_found, address, "nothing is there");
      AskingResult result;
      result.found = there[address];
      return result;
    };
    world.file_for = [](const std::string& name) {
      if (name == "taken") throw ConfigError("taken.lua: is there already");
      return name + ".lua";
    };
    world.check = [this](const std::string& file, const std::string& lua) {
      checked = lua;
      check_rig(lua::read_recorded_rig(lua::library(), {file, lua}, {}));
    };
    world.today = "2026-11-20";
  }

  void plug_in(const std::string& bus, const std::string& address, const std::string& driver,
               std::vector<FoundInstrument> what = {}) {
    world.plugged_in.push_back(
        {{"bus", bus}, {"address", address}, {"name", ""}, {"place", ""}, {"driver", driver}});
    if (!what.empty()) there[address] = std::move(what);
  }

  /// Answers by key, else the default, up to the question `until`; "" for to the end. The keys in
  /// the order in which they were asked.
  std::vector<std::string> go(RigInterview& interview, const Answers& answers,
                              const std::string& until = "") {
    std::vector<std::string> keys;
    while (!interview.done() && interview.question().key != until) {
      const InterviewQuestion question = interview.question();
      keys.push_back(question.key);
      const auto given = answers.find(question.key);
      const InterviewReply reply = interview.answer(given == answers.end() ? "" : given->second);
      EXPECT_EQ(reply.kind, Kind::accepted) << question.key << ": " << reply.text;
      if (reply.kind != Kind::accepted) break;
    }
    return keys;
  }
};

const Answers kUsb3103{{"coils", "usb3103"},
                       {"coils.address", "hid:09db:009c"},
                       {"coils.amperes_per_volt", "2"},
                       {"coils.current_limit", "12 A"}};

TEST_F(NewRig, AnswersMakeAFileThatTheCheckerTakes) {
  RigInterview interview(world, "bench");
  go(interview, kUsb3103);
  ASSERT_TRUE(interview.done());
  EXPECT_EQ(checked, to_lua(interview.draft()));
  const RigDescription rig = lua::read_recorded_rig(lua::library(), {"bench.lua", checked}, {});
  const auto& coils = std::get<ConfigTable>(rig.table.at("coils").value);
  EXPECT_EQ(std::get<double>(coils.at("current_limit").value), 12);
  EXPECT_EQ(std::get<std::string>(coils.at("address").value), "hid:09db:009c");
  EXPECT_FALSE(coils.contains("enable_line")) << "none";
  EXPECT_TRUE(rig.table.contains("sample"));
  EXPECT_FALSE(rig.table.contains("stage")) << "left out";
}

TEST_F(NewRig, AWrongAnswerIsExplainedAndAskedAgain) {
  RigInterview interview(world, "bench");
  go(interview, kUsb3103, "coils.current_limit");
  const auto refused = [&](const std::string& typed) {
    const InterviewReply reply = interview.answer(typed);
    EXPECT_EQ(reply.kind, Kind::refused) << typed;
    EXPECT_EQ(interview.question().key, "coils.current_limit");
    EXPECT_EQ(interview.draft().find("coils")->find("current_limit"), nullptr) << typed;
    return reply.text;
  };
  EXPECT_EQ(refused("30 A"), "coils.current_limit is 30 A; it must be 0.1 to 20 A");
  EXPECT_TRUE(has(refused("12"), "needs its unit, such as 12 A"));
  EXPECT_TRUE(has(refused("12 V"), "is a voltage"));
  EXPECT_TRUE(has(refused("lots"), "is not understood"));
  EXPECT_TRUE(has(refused(""), "an answer is needed"));
  EXPECT_EQ(interview.answer("12 A").kind, Kind::accepted);
}

TEST_F(NewRig, BackGoesOneQuestionBackAndOffersWhatWasAnswered) {
  RigInterview interview(world, "bench");
  EXPECT_EQ(interview.answer("back").kind, Kind::refused);
  go(interview, kUsb3103, "coils.interlock_total_current");
  EXPECT_EQ(interview.answer("back").kind, Kind::back);
  EXPECT_EQ(interview.question().key, "coils.current_limit");
  EXPECT_EQ(interview.question().fallback, "12 A");
  EXPECT_EQ(interview.draft().find("coils")->find("current_limit"), nullptr);
  // Another instrument in its place: nothing of the first one stays.
  for (int i = 0; i < 3; ++i) interview.answer("back");
  ASSERT_EQ(interview.question().key, "coils");
  EXPECT_EQ(interview.draft().find("coils"), nullptr);
  EXPECT_EQ(interview.answer("none").kind, Kind::accepted);
  go(interview, {});
  EXPECT_FALSE(has(checked, "coils = {")) << checked;
}

TEST_F(NewRig, AQuestionMarkExplainsAndQuitLeaves) {
  RigInterview interview(world, "bench");
  go(interview, kUsb3103, "coils.amperes_per_volt");
  const InterviewReply reply = interview.answer("?");
  EXPECT_EQ(reply.kind, Kind::explained);
  EXPECT_TRUE(has(reply.text, "the interlock cannot notice")) << reply.text;
  EXPECT_TRUE(has(reply.text, "It wants a number, 0.01 to 100.")) << reply.text;
  EXPECT_EQ(interview.question().key, "coils.amperes_per_volt");
  EXPECT_EQ(interview.answer("quit").kind, Kind::quit);
  EXPECT_TRUE(interview.left());
  EXPECT_FALSE(interview.done());
}

TEST_F(NewRig, APortIsAskedOnlyAfterAYes) {
  for (const char* port : {"serial:/dev/ttyUSB0", "serial:/dev/ttyUSB1", "serial:/dev/ttyUSB2"})
    plug_in("serial", port, "", {found("sutter_mp285", port, {{"stage"}}, 9600)});
  RigInterview interview(world, "bench");
  go(interview, {}, "another");
  EXPECT_TRUE(asked.empty()) << "no is the default";
  interview.answer("back");
  EXPECT_TRUE(has(interview.question().before, "any byte stops a Sutter MP-285"));
  EXPECT_TRUE(has(interview.question().before, " s at most")) << "and the time";
  interview.answer("yes");
  EXPECT_EQ(asked, std::vector<std::string>{"serial:/dev/ttyUSB2"});
  for (int i = 0; i < 3; ++i) interview.answer("back");
  interview.answer("all");
  EXPECT_EQ(interview.question().key, "another");
  EXPECT_EQ(asked.size(), 4U);
  interview.answer("back");
  interview.answer("none");
  EXPECT_EQ(interview.question().key, "another");
  EXPECT_EQ(asked.size(), 4U);
}

TEST_F(NewRig, WhatDoesNotAnswerIsToldAndTheInterviewGoesOn) {
  RigInterview interview(world, "bench");
  go(interview, {}, "another");
  EXPECT_EQ(interview.answer("somewhere").kind, Kind::refused) << "no address";
  interview.answer("tcp:10.0.0.11:5025");
  const InterviewReply reply = interview.answer("yes");
  EXPECT_EQ(reply.kind, Kind::accepted);
  EXPECT_TRUE(has(reply.text, "nothing is there")) << reply.text;
  EXPECT_EQ(interview.question().key, "another");
}

// Those that ship, and a file that lies where the rig file will.
TEST_F(NewRig, InstrumentsInLuaAreOfferedForTheirRoleAndUnderNamesOfTheirOwn) {
  const TemporaryFolder folder;
  const std::string bench = (folder.path() / "bench").string();
  std::ofstream(folder.path() / "oven.lua")
      << "local set = settings { hottest = { default = 90, unit = 'degC', min = 20, max = 300, "
         "help "
         "= 'to which it may heat' } }\n"
         "return { title = 'Acme oven', kind = 'actuator', measures = 'temperature', link = {}, "
         "identity = '*IDN?', make_safe = 'OFF', properties = { set_point = { unit = 'degC', set = "
         "'SP %.1f', min = 0, max = set.hottest } }, emulator = { answers = { ['*IDN?'] = "
         "'A,O,1,2' "
         "} } }";
  std::ofstream(folder.path() / "other_rig.lua") << "return { title = 'none' } -- identity";
  world.folders = {VITREO_SOURCE_DIR "/scripts"};
  world.check = [this](const std::string& file, const std::string& lua) {
    checked = lua;
    RigDescription rig = lua::read_recorded_rig(lua::library(), {file, lua}, {});
    rig.folders = world.folders;
    check_rig(rig);
  };
  RigInterview interview(world, bench);
  const auto options = [&] {
    std::set<std::string> words;
    for (const AnswerOption& one : interview.question().options) words.insert(one.word);
    return words;
  };
  go(interview, kUsb3103, "stage");
  EXPECT_TRUE(options().contains("kdc101") && options().contains("conex_cc"));
  EXPECT_FALSE(options().contains("ne1000"));
  Answers answers{{"stage", "conex_cc"},
                  {"stage.address", "emulated"},
                  {"stage.carries", "sensor"},
                  {"stage.focus_axis", "z"}};
  go(interview, answers, "further");
  for (const char* const file : {"ne1000", "tc038d", "oven", "conex_cc"})
    EXPECT_TRUE(options().contains(file)) << file;
  for (const char* const file : {"other_rig", "arduino", "usb3103"})
    EXPECT_FALSE(options().contains(file)) << file;
  interview.answer("oven");
  EXPECT_EQ(interview.question().fallback, "temperature");
  EXPECT_TRUE(has(interview.answer("coils").text, "is a role already"));
  EXPECT_TRUE(has(interview.answer("Oven").text, "is no name"));
  interview.answer("oven");
  EXPECT_EQ(interview.question().key, "oven.address");
  EXPECT_EQ(interview.question().wanted, "an address such as serial:/dev/ttyUSB0");
  interview.answer("emulated");
  EXPECT_EQ(interview.question().key, "oven.hottest");
  EXPECT_TRUE(has(interview.question().text, "to which it may heat"));
  EXPECT_EQ(interview.question().fallback, "90 degC");
  EXPECT_EQ(interview.answer("400 degC").kind, Kind::refused);
  interview.answer("60 degC");
  ASSERT_EQ(interview.question().key, "further") << "as long as there is a further one";
  go(interview, {});
  ASSERT_TRUE(interview.done());
  EXPECT_TRUE(has(checked, "  -- Acme oven.\n  oven = {\n    driver = \"oven\",")) << checked;
  EXPECT_TRUE(has(checked, "driver = \"conex_cc\"")) << checked;
}

TEST_F(NewRig, WhatAnInstrumentHasToldIsOfferedWithItsUnit) {
  plug_in("genicam", "genicam:X", "genicam");
  there["genicam"] = {found("genicam", "genicam:X",
                            {{"top_camera", {{"width_px", "1384"}, {"frame_rate", "15"}}}})};
  plug_in(
      "serial", "serial:/dev/ttyUSB0", "",
      {found("zaber", "serial:/dev/ttyUSB0",
             {{"stage", {{"x", "{ device = 2, axis = 1 }"}, {"y", "{ device = 2, axis = 2 }"}}}},
             9600)});
  RigInterview interview(world, "bench");
  const auto fallback = [&](const std::string& key, const Answers& answers) {
    go(interview, answers, key);
    return interview.question().fallback;
  };
  EXPECT_EQ(fallback("top_camera", {{"ask genicam", "yes"}, {"ask serial:/dev/ttyUSB0", "yes"}}),
            "genicam:X");
  EXPECT_EQ(fallback("top_camera.width_px", {}), "1384");
  EXPECT_EQ(fallback("top_camera.frame_rate", {{"top_camera.height_px", "1036"}}), "15 Hz");
  EXPECT_EQ(fallback("stage.axes", {{"top_camera.effective_pixel", "14.3 um"}}), "x, y");
  EXPECT_EQ(fallback("stage.x.device", {}), "2");
  EXPECT_EQ(fallback("stage.y.axis", {{"stage.x.step", "3 um"}}), "2");
  go(interview, {{"stage.y.step", "3 um"}, {"stage.carries", "sensor"}, {"stage.focus_axis", "y"}});
  EXPECT_TRUE(has(checked, "y = { axis = 2, device = 2, step = 3 * um")) << checked;
}

// The axes' numbers can be swapped, whatever was proposed.
TEST_F(NewRig, TheAxesOfAChainCanBeTypedInAnyOrderAndNoTwoAreOne) {
  RigInterview interview(world, "bench");
  const Answers answers{{"stage", "zaber"},       {"stage.address", "/dev/ttyUSB0"},
                        {"stage.axes", "x, z"},   {"stage.x.device", "2"},
                        {"stage.x.step", "3 um"}, {"stage.z.step", "3 um"}};
  go(interview, answers, "stage.z.device");
  const InterviewReply same = interview.answer("2");
  EXPECT_EQ(same.kind, Kind::refused);
  EXPECT_TRUE(has(same.text, "x and z are the same one")) << same.text;
  EXPECT_EQ(interview.answer("1").kind, Kind::accepted);
}

TEST_F(NewRig, AmongSeveralInstrumentsAPersonMustChoose) {
  for (const char* serial : {"A", "B"}) {
    const std::string address = std::string("hid:09db:009c:") + serial;
    plug_in("hid", address, "usb3103",
            {found("usb3103", address, {{"coils"}}), found("led", address, {{"lamp"}})});
  }
  RigInterview interview(world, "bench");
  go(interview, {}, "coils");
  EXPECT_EQ(interview.question().fallback, "");
  EXPECT_EQ(interview.answer("").kind, Kind::refused);
  EXPECT_EQ(interview.answer("2").kind, Kind::accepted);
  go(interview, kUsb3103, "lamp");
  EXPECT_EQ(interview.question().fallback, "hid:09db:009c:A") << "the other one is the coils'";
}

TEST_F(NewRig, WhichSupplyDrivesWhichCoilIsAskedOneByOneAndAnAddressGivenTwiceIsTold) {
  RigInterview interview(world, "bench");
  go(interview, {{"coils", "kepco_bop"}, {"coils.supplies", "3"}}, "coils.supply 1");
  EXPECT_EQ(interview.answer("ttyUSB0").kind, Kind::refused);
  EXPECT_EQ(interview.answer("tcp:10.0.0.11:5025").kind, Kind::accepted);
  EXPECT_EQ(interview.question().fallback, "tcp:10.0.0.12:5025");
  const InterviewReply twice = interview.answer("tcp:10.0.0.11:5025");
  EXPECT_EQ(twice.kind, Kind::refused);
  EXPECT_TRUE(has(twice.text, "channel 2 is that of coils, channel 1 already")) << twice.text;
  EXPECT_EQ(interview.answer("tcp:10.0.0.20:5025").kind, Kind::accepted);
  go(interview, {{"coils.current_limit", "5 A"}, {"coils.voltage_limit", "20 V"}});
  EXPECT_TRUE(
      has(checked, "\"tcp:10.0.0.11:5025, tcp:10.0.0.20:5025, tcp:10.0.0.21:5025\", -- of coil 1"))
      << checked;
}

TEST_F(NewRig, TheAddressOfAnotherRoleIsRefused) {
  RigInterview interview(world, "bench");
  const Answers answers{{"stage", "sutter_mp285"},       {"stage.address", "/dev/ttyUSB0"},
                        {"stage.carries", "sensor"},     {"stage.focus_axis", "z"},
                        {"stage.travel_min", "0, 0, 0"}, {"stage.travel_max", "1, 1, 1 mm"},
                        {"rotation_stage", "zaber"}};
  go(interview, answers, "rotation_stage.address");
  const InterviewReply reply = interview.answer("/dev/ttyUSB0");
  EXPECT_EQ(reply.kind, Kind::refused);
  EXPECT_TRUE(has(reply.text, "already: serial:/dev/ttyUSB0")) << reply.text;
}

TEST_F(NewRig, ANameThatIsTakenIsRefusedBeforeAnythingElse) {
  EXPECT_THROW(RigInterview(world, "taken"), ConfigError);
  RigInterview interview(world, "");
  EXPECT_EQ(interview.question().key, "name");
  EXPECT_EQ(interview.answer("taken").kind, Kind::refused);
  EXPECT_EQ(interview.answer("bench").kind, Kind::accepted);
  EXPECT_EQ(interview.draft().file, "bench.lua");
}

TEST_F(NewRig, AFileThatTheCheckerRefusesIsNotDone) {
  world.check = [](const std::string&, const std::string&) {
    throw ConfigError("bench.lua:3: no");
  };
  RigInterview interview(world, "bench");
  go(interview, {}, "write");
  EXPECT_TRUE(has(interview.question().before, "return {")) << "it is shown";
  EXPECT_EQ(interview.answer("no").kind, Kind::refused);
  EXPECT_EQ(interview.answer("yes").text, "bench.lua:3: no");
  EXPECT_FALSE(interview.done());
}

/// Drivers with their settings' texts; each in the role that asks for it.
struct Asked {
  std::string role;
  std::string driver;
};

// A text for a setting that no driver reads would never be asked, and one that must be typed would
// have to be typed into nothing.
TEST_F(NewRig, EverySettingTextIsAskedAndReadByItsDriver) {
  const std::vector<Asked> all{
      {"top_camera", "genicam"},    {"side_camera", "iidc"}, {"top_camera", "opencv_camera"},
      {"coils", "usb3103"},         {"coils", "kepco_bop"},  {"stage", "sutter_mp285"},
      {"stage", "sutter_mpc200"},   {"stage", "zaber"},      {"rotation_stage", "zaber"},
      {"lens_mover", "pololu_tic"}, {"lamp", "led"},         {"pedal", "foot_pedal"},
      {"field_probe", "scpi_probe"}};
  for (const Asked& one : all) {
    RigInterview interview(world, "bench");
    std::string address = example_address(one.driver);
    if (one.driver == "scpi_probe" || one.driver == "kepco_bop") address = "serial:/dev/ttyUSB0";
    Answers answers{{one.role, one.driver},
                    {one.role + ".address", address},
                    {"coils.supplies", "1"},
                    {"coils.supply 1", address}};
    std::set<std::string> wanted;
    const auto want = [&](const std::vector<SettingText>& texts, const std::string& below) {
      for (const SettingText& text : texts) {
        wanted.insert(one.role + "." + below + text.key);
        if (text.need != Need::confirmed)
          answers[one.role + "." + below + text.key] = text.stand_in;
      }
    };
    want(setting_texts(one.role, one.driver), "");
    if (one.role == "stage" && one.driver == "zaber") want(zaber_axis_texts(), "z.");
    ASSERT_FALSE(wanted.empty()) << one.driver;
    for (const std::string& key : go(interview, answers)) wanted.erase(key);
    EXPECT_TRUE(interview.done()) << one.driver;
    EXPECT_TRUE(wanted.empty()) << one.driver << ": " << *wanted.begin() << " was not asked";
  }
}

TEST_F(NewRig, OnlyTheModelsOwnTextsAreThoseOfNoRole) {
  RigInterview interview(world, "bench");
  const std::vector<std::string> keys = go(interview, {});
  for (const SettingText& text : setting_texts("model", ""))
    EXPECT_NE(std::find(keys.begin(), keys.end(), std::string("model.") + text.key), keys.end());
  std::set<std::string> roles;
  for (const RoleText& role : role_texts()) roles.insert(role.role);
  // A heartbeat line and a sensor of the currents are wired to what is there already: the first
  // day's rig does without.
  const std::set<std::string> not_asked{"sample", "pose_sensor", "enable_line", "current_sensor"};
  for (const std::string& role : role_names())
    EXPECT_TRUE(roles.contains(role) || not_asked.contains(role)) << role;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
