// The command line: what it accepts, how it refuses, and the codes it leaves with.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/program/terminal.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <sstream>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

const char* const kIdle = R"(
local units = require "units"
return {
  title = "Idle",
  needs = { "coils" },
  parameters = {
    pause = { unit = "s", default = 0.2, min = 0, max = 10, help = "how long to wait" },
    speed = { unit = "mm/s", default = 1e-3, min = 0, max = 2e-3 },
    mode = { choices = { "calm", "brisk" }, default = "calm" },
    times = { default = 1, min = 1, max = 5, integer = true },
  },
  run = function(rig, p, run)
    run:wait(p.pause)
    run:result("waited", p.pause, "s")
    run:result("speed", p.speed, "m/s")
  end,
}
)";

bool one_line(const std::string& text) {
  return !text.empty() && text.find('\n') == text.size() - 1;
}

/// Refused before anything was opened: the code, one line that has `words`, and no run's folder.
void expect_refused(const Workplace& place, const std::string& command,
                    const std::vector<std::string>& words) {
  const Spoken spoken = place.vitreo(command);
  EXPECT_EQ(spoken.exit_code, 2) << command << "\n" << spoken.err;
  EXPECT_TRUE(one_line(spoken.err)) << spoken.err;
  for (const std::string& word : words)
    EXPECT_NE(spoken.err.find(word), std::string::npos) << word << " in " << spoken.err;
  EXPECT_EQ(place.runs(), 0) << command;
}

TEST(CommandLine, AProtocolRunsAndItsResultsCloseTheJson) {
  const Workplace place;
  place.write("idle.lua", kIdle);
  const Spoken spoken = place.vitreo("run idle.lua pause=500ms speed=0.5mm/s --json");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  const auto json = nlohmann::json::parse(spoken.out);
  EXPECT_EQ(json["outcome"], "completed");
  EXPECT_DOUBLE_EQ(json["results"]["waited"], 0.5);
  EXPECT_DOUBLE_EQ(json["results"]["speed"], 0.5e-3);
  EXPECT_GE(json["results"]["experiment_time"].get<double>(), 0.5);
  EXPECT_TRUE(
      std::filesystem::exists(place.folder() / json["run"].get<std::string>() / "report.html"));
  EXPECT_TRUE(one_line(spoken.out)) << "one object, one line";
}

TEST(CommandLine, BadArgumentsAreRefusedInOneLineThatNamesThem) {
  const Workplace place;
  place.write("idle.lua", kIdle);
  expect_refused(place, "run idle.lua speed=5um", {"speed"});
  expect_refused(place, "run idle.lua speed=50mm/s", {"speed", "2 mm/s"});
  expect_refused(place, "run idle.lua sped=1mm/s", {"sped", "speed"});
  expect_refused(place, "run idle.lua pause=3", {"pause"});
  expect_refused(place, "run idle.lua pause=nan", {"pause"});
  expect_refused(place, "run idle.lua mode=frantic", {"mode", "calm", "brisk"});
  expect_refused(place, "run idle.lua times=1.5", {"times"});
  expect_refused(place, "run idle.lua times", {"times"});
}

TEST(CommandLine, BadFilesAreRefusedInOneLineWithTheirPlace) {
  const Workplace place;
  place.write("idle.lua", kIdle);
  expect_refused(place, "run nowhere.lua", {"nowhere.lua"});
  place.write("broken.lua", "return {\n  title = \n}\n");
  expect_refused(place, "run broken.lua", {"broken.lua:3"});
  place.write("odd.lua", "return { title = 'odd', tilte = 1, needs = {}, run = function() end }");
  expect_refused(place, "run odd.lua", {"tilte", "title"});
  place.write("rig.lua",
              "return {\n  title = 'r',\n  coils = { driver = 'usb3103', curent_limit = 3 },\n}\n");
  expect_refused(place, "run idle.lua --rig rig.lua",
                 {"rig.lua:3", "curent_limit", "current_limit"});
  place.write("bounds.lua", "return {\n  coils = { current_limit = 3000 },\n}\n");
  expect_refused(place, "run idle.lua --rig bounds.lua", {"bounds.lua:2", "current_limit", "20 A"});
  place.write("bare.lua", "return { title = 'bare' }");
  expect_refused(place, "run idle.lua --rig bare.lua", {"bare.lua", "coils"});
  expect_refused(place, "run idle.lua --rig nowhere_rig.lua", {"nowhere_rig.lua"});
}

TEST(CommandLine, AScriptThatFailsLeavesAnEndRecordWithItsLine) {
  const Workplace place;
  place.write("fails.lua",
              "return { title = 'fails', needs = { 'coils' }, run = function(rig, p, run)\n"
              "  rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }\n"
              "  error('on purpose')\nend }");
  const Spoken spoken = place.vitreo("run fails.lua --json");
  EXPECT_EQ(spoken.exit_code, 1);
  const auto json = nlohmann::json::parse(spoken.out);
  EXPECT_EQ(json["outcome"], "failed");
  EXPECT_NE(json["reason"].get<std::string>().find("fails.lua:3: on purpose"), std::string::npos)
      << json["reason"];
  EXPECT_TRUE(
      std::filesystem::exists(place.folder() / json["run"].get<std::string>() / "report.html"));
}

TEST(CommandLine, CtrlCStopsALongRunAndSaysSo) {
  const Workplace place;
  place.write("endless.lua",
              "return { title = 'endless', needs = { 'coils' }, run = function(rig, p, run)\n"
              "  rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }\n"
              "  while true do pcall(function() run:wait(0.05) end) end\nend }");
  const std::string command = "cd '" + place.folder().string() +
                              "' && timeout --foreground -s INT 1.5 '" VITREO_PROGRAM
                              "' run endless.lua --real-time --json >out 2>err";
  const int status = std::system(command.c_str());
  EXPECT_EQ(WEXITSTATUS(status), 124)
      << "timeout's own code: it did end by itself after the signal";
  const auto json = nlohmann::json::parse(place.read("out"));
  EXPECT_EQ(json["outcome"], "stopped");
}

TEST(CommandLine, AnEndlessLoopWithoutAWaitIsStoppedToo) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; this loop has none";
#endif
  const Workplace place;
  place.write("busy.lua",
              "return { title = 'busy', needs = {}, run = function() while true do pcall(error, "
              "'x') end end }");
  const std::string command = "cd '" + place.folder().string() +
                              "' && timeout --foreground -s INT 1 '" VITREO_PROGRAM
                              "' run busy.lua --json >out 2>err";
  EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 124);
  EXPECT_EQ(nlohmann::json::parse(place.read("out"))["outcome"], "stopped");
}

/// A pattern that goes back and forth for longer than a person waits; it was a call that no hook
/// reached.
TEST(CommandLine, APromptWhoseStatementSearchesForHoursIsStoppedByCtrlCAndGoesOn) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; this search has none";
#endif
  const Workplace place;
  Terminal terminal(place.folder());
  ASSERT_TRUE(terminal.prompts());
  terminal.type("rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }\r");
  ASSERT_TRUE(terminal.prompts()) << terminal.unseen();
  terminal.type(
      "print('st' .. 'uck') string.find(string.rep('a', 60), string.rep('a-', 60) .. 'b')\r");
  ASSERT_TRUE(terminal.sees("stuck")) << terminal.unseen();
  usleep(
      300'000);  // print has yet to come back, and the search to begin, which nothing outside shows
  terminal.type("\x03");
  usleep(100'000);
  terminal.type("\x03");
  EXPECT_TRUE(terminal.prompts()) << terminal.unseen();
  terminal.type("print('went' .. ' on')\r");
  EXPECT_TRUE(terminal.sees("went on")) << terminal.unseen();
}

TEST(CommandLine, AFolderWithAProtocolsNameIsNotTakenForTheProtocol) {
  const Workplace place;
  std::filesystem::create_directory(place.folder() / "hello_rig");
  const Spoken said = place.vitreo("describe hello_rig");
  EXPECT_EQ(said.exit_code, 0) << said.err;
}

TEST(CommandLine, HelpListAndDescribeAnswer) {
  const Workplace place;
  EXPECT_NE(place.vitreo("--help").out.find("For instance"), std::string::npos);
  const Spoken list = place.vitreo("list --json");
  bool found = false;
  for (const auto& row : nlohmann::json::parse(list.out)) {
    EXPECT_FALSE(row.contains("error")) << row;
    found = found || row["name"] == "servo_square";
  }
  EXPECT_TRUE(found);
  const auto described = nlohmann::json::parse(place.vitreo("describe servo_square --json").out);
  EXPECT_EQ(described["name"], "servo_square");
  EXPECT_FALSE(described["parameters"].empty());
  EXPECT_EQ(place.vitreo("describe nothing_like_it").exit_code, 2);
  EXPECT_EQ(place.vitreo("run").exit_code, 2);
  EXPECT_EQ(place.vitreo("fly").exit_code, 2);
}

TEST(CommandLine, AProtocolRunsOnTheRigThatItNamesUnlessAnotherIsAskedFor) {
  const Workplace place;
  EXPECT_EQ(nlohmann::json::parse(place.vitreo("describe calibrate_coils --json").out)["rig"],
            "calibration");
  EXPECT_NE(place.vitreo("describe calibrate_coils").out.find("\nrig: calibration, unless another"),
            std::string::npos);
  EXPECT_EQ(place.vitreo("check calibrate_coils").exit_code, 0);
  const Spoken another = place.vitreo("check calibrate_coils --rig simulated");
  EXPECT_EQ(another.exit_code, 2);
  EXPECT_NE(another.err.find("needs the role 'field_probe'"), std::string::npos) << another.err;
  EXPECT_EQ(place.vitreo("check calibrate_coils --rig no_such_rig").exit_code, 2);
}

TEST(CommandLine, ItStartsWithoutTheLibrariesThatFewRunsNeed) {
#if !defined(__x86_64__) || defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "they are linked as usual here";
#endif
  ASSERT_EQ(std::system("LD_TRACE_LOADED_OBJECTS=1 '" VITREO_PROGRAM "' | grep -q libopencv_core"),
            0);
  EXPECT_NE(std::system("LD_TRACE_LOADED_OBJECTS=1 '" VITREO_PROGRAM
                        "' | grep -E 'avcodec|gdal|aravis|opencv_(videoio|imgcodecs|dnn)'"),
            0)
      << "docs/decisions/0005-lazy-libraries.md";
}

TEST(CommandLine, WithJsonAnErrorIsAnObjectToo) {
  const Workplace place;
  for (const char* words :
       {"run nowhere.lua --json", "check hold --rig nowhere --json", "show nope --json",
        "runs --outcome odd --json", "run hello_rig --sed 3 --json", "control status --json",
        "docs sefety --json", "new thing x --json"}) {
    const Spoken spoken = place.vitreo(words);
    EXPECT_EQ(spoken.exit_code, 2) << words << spoken.err;
    EXPECT_TRUE(one_line(spoken.err)) << spoken.err;
    const auto json = nlohmann::json::parse(spoken.out, nullptr, false);
    ASSERT_TRUE(json.is_object()) << words << spoken.out;
    EXPECT_EQ(json["exit_code"], 2) << words;
    EXPECT_EQ("vitreo: " + json["error"].get<std::string>() + "\n", spoken.err);
  }
  EXPECT_EQ(place.vitreo("show nope").out, "");
}

TEST(CommandLine, WhatAProgramReadsIsJsonEverywhere) {
  const Workplace place;
  place.write("idle.lua", kIdle);
  for (const char* words :
       {"devices --json", "devices --rig simulated --json",
        "devices --rig simulated --test lens_mover --json", "docs --json", "docs safety --json",
        "docs api --json", "docs stubs here --json", "list --json", "faults --json",
        "describe idle.lua --json", "check idle.lua --json", "test idle.lua --stops 2 --json",
        "runs --json", "new protocol fresh --json"}) {
    const Spoken spoken = place.vitreo(words);
    EXPECT_EQ(spoken.exit_code, 0) << words << spoken.err;
    std::istringstream lines(spoken.out);
    for (std::string line; std::getline(lines, line);)
      EXPECT_TRUE(nlohmann::json::accept(line)) << words << ": " << line.substr(0, 200);
    EXPECT_FALSE(spoken.out.empty()) << words;
  }
  const auto tested =
      nlohmann::json::parse(place.vitreo("devices --rig simulated --test lens_mover --json").out);
  EXPECT_EQ(tested["role"], "lens_mover");
  EXPECT_EQ(tested["passed"], true);
}

TEST(CommandLine, TextThatIsNoUtf8IsReplacedInJson) {
  const Workplace place;
  place.write("odd.lua", "return { title = 'b\\xffd', run = function() error('x\\xfe') end }");
  for (const auto& [words, code] :
       std::vector<std::pair<std::string, int>>{{"run odd.lua --json", 1},
                                                {"describe odd.lua --json", 0},
                                                {"check odd.lua --json", 8},
                                                {"show last --json", 0}}) {
    const Spoken spoken = place.vitreo(words);
    EXPECT_EQ(spoken.exit_code, code) << words << spoken.err;
    EXPECT_TRUE(nlohmann::json::accept(spoken.out)) << words << spoken.out;
  }
}

TEST(CommandLine, SlipsOfThePenGetASuggestionOrWhatThereIs) {
  const Workplace place;
  place.write("idle.lua", kIdle);
  for (const auto& [words, answer] : std::vector<std::pair<std::string, std::string>>{
           {"run servo_sqare",
            "there is no protocol 'servo_sqare', and no file of that name; did you mean "
            "servo_square?"},
           {"run zzzzzz", "vitreo list names them"},
           {"run idle.lua --rig simulatd",
            "there is no rig 'simulatd', and no file of that name; did you mean simulated?"},
           {"run idle.lua --sed 3", "'--sed' is not understood; did you mean --seed?"},
           {"control pase", "'pase' is not understood; did you mean pause?"},
           {"control stop now", "'now': stop takes no text"},
           {"runs --outcome finished", "--outcome: wants one of completed, failed, stopped"},
           {"runs --since yesterday", "--since: wants a time such as 2026-11-21"},
           {"export last", "export: wants --as with one or more of csv,mcap,tiff,ome,mkv,hdf5"},
           {"export last --as csv,tif", "--as tif: is no format; did you mean tiff?"},
           {"docs safety here", "only stubs are written into a folder"},
           {"run idle.lua --view-port 70000", "70000"}}) {
    expect_refused(place, words, {answer});
  }
  EXPECT_EQ(place.vitreo("runs --since 2026-11 --outcome failed").out, "no such runs in runs\n");
}

TEST(CommandLine, ARunsFolderThatCannotBeMadeIsRefusedBeforeAnythingIsOpened) {
  const Workplace place;
  place.write("idle.lua", kIdle);
  place.write("occupied", "");
  expect_refused(place, "run idle.lua --out occupied/runs",
                 {"--out occupied/runs: ", "occupied is no folder"});
  if (geteuid() == 0) return;  // root may write everywhere
  std::filesystem::create_directory(place.folder() / "closed");
  std::filesystem::permissions(place.folder() / "closed", std::filesystem::perms(0500));
  expect_refused(place, "run idle.lua --out closed/runs",
                 {"--out closed/runs: ", "Permission denied"});
}

TEST(CommandLine, WhatCannotBePrintedIsAnErrorAndAReaderThatIsGoneIsNone) {
  const Workplace place;
  place.write("idle.lua", kIdle);
  const auto code = [&place](const std::string& line) {
    return WEXITSTATUS(std::system(
        ("cd '" + place.folder().string() + "' && exec bash -c \"" + line + "\"").c_str()));
  };
  const std::string program = "'" VITREO_PROGRAM "' ";
  EXPECT_EQ(code(program + "docs api >/dev/full 2>err"), 5);
  EXPECT_NE(place.read("err").find("cannot be written to the standard output"), std::string::npos)
      << place.read("err");
  EXPECT_EQ(code(program + "list >/dev/full 2>err"), 5);
  EXPECT_EQ(code(program + "run idle.lua --json >/dev/full 2>err"), 5)
      << "the record is whole, what is read is not";
  EXPECT_EQ(code("echo 'print(1)' | " + program + ">/dev/full 2>err"), 5);
  EXPECT_EQ(code("set -o pipefail; " + program + "docs api | head -n 1 >out 2>err"), 0);
  EXPECT_EQ(place.read("out"), "# What scripts can call\n");
}

TEST(CommandLine, ProgressFitsTheTerminalAndIsPlainElsewhere) {
  const Workplace place;
  Terminal narrow(place.folder(), "run hello_rig", 30);
  EXPECT_EQ(narrow.end(), 0);
  std::string drawn;
  for (const char c : narrow.screen()) {
    if (c != '\r' && c != '\n') {
      drawn += c;
      continue;
    }
    const bool progress = drawn.find(" %") != std::string::npos;
    EXPECT_TRUE(!progress || drawn.size() < 30) << drawn;
    drawn.clear();
  }
  EXPECT_NE(narrow.screen().find("\r  0 %  frame 1 of 3\r"), std::string::npos) << narrow.screen();
  const Spoken piped = place.vitreo("run hello_rig");
  EXPECT_NE(piped.err.find("\n 33 %  frame 2 of 3"), std::string::npos) << piped.err;
  EXPECT_EQ(piped.err.find('['), std::string::npos) << piped.err;
}

TEST(CommandLine, OnlyATerminalSeesColorsAndNoColorSwitchesThemOff) {
  const Workplace place;
  place.write("idle.lua", kIdle);
  Terminal colors(place.folder(), "run idle.lua");
  EXPECT_TRUE(colors.sees("\x1b[32mcompleted\x1b[0m")) << colors.unseen();
  setenv("NO_COLOR", "1", 1);
  Terminal none(place.folder(), "run idle.lua");
  unsetenv("NO_COLOR");
  EXPECT_TRUE(none.sees("completed")) << none.unseen();
  EXPECT_EQ(none.screen().find('\x1b'), std::string::npos) << none.screen();
  EXPECT_EQ(place.vitreo("run idle.lua").out.find('\x1b'), std::string::npos);
}

TEST(Prompt, AnExpressionGoesOnInTheNextLineAsAStatementDoes) {
  const Workplace place;
  EXPECT_EQ(place.vitreo("", "20 +\n22\n#{ 1,\n2 }\nlocal x = 1\nx = nil\n").out, "42\n2\n");
  const Spoken cut = place.vitreo("", "20 +\n");
  EXPECT_EQ(cut.exit_code, 1);
  EXPECT_NE(cut.err.find("near <eof>"), std::string::npos) << cut.err;
  const Spoken wrong = place.vitreo("", "{ 1, gr\u00fcn = 2 }\n");
  EXPECT_NE(wrong.err.find("near '<\\195>'"), std::string::npos) << wrong.err;
}

TEST(Prompt, AnErrorAboutMegabytesIsAFewLines) {
  const Workplace place;
  const Spoken spoken = place.vitreo("", std::string(3 << 20, 'a') + "\nprint('still here')\n");
  EXPECT_EQ(spoken.exit_code, 1);
  EXPECT_LT(spoken.err.size(), 3000U);
  EXPECT_NE(spoken.err.find("bytes ... "), std::string::npos) << spoken.err;
  EXPECT_EQ(spoken.out, "still here\n");
}

TEST(Prompt, ItAnswersInAPipe) {
  const Workplace place;
  const Spoken spoken = place.vitreo(
      "",
      "1 + 1\nfor i = 1, 2 do\n  print(i * 10)\nend\nrig.coils:info().limit\nnonsense(\n)\n"
      "print('still here')\n");
  EXPECT_EQ(spoken.exit_code, 1) << spoken.err;  // a statement failed
  const std::string all = spoken.out + spoken.err;
  for (const char* word : {"2", "10", "20", "12", "nonsense", "still here"})
    EXPECT_NE(all.find(word), std::string::npos) << word << " in " << all;
}

TEST(Prompt, BinaryJunkDoesNotEndIt) {
  const Workplace place;
  const Spoken spoken =
      place.vitreo("", std::string("\x1bLua\0\xff\xfe\n", 8) + "print('still here')\n");
  EXPECT_NE((spoken.out + spoken.err).find("still here"), std::string::npos) << spoken.err;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
