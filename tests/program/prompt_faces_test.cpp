// The prompt of the built program: on a terminal, in a pipe and from a file.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/program/terminal.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kCtrlC = "\x03";
constexpr const char* kCtrlD = "\x04";
constexpr const char* kUp = "\x1b[A";

TEST(TerminalPrompt, LinesAreEditedContinuedAndKeptForTheNextSession) {
  const Workplace place;
  {
    Terminal terminal(place.folder());
    ASSERT_TRUE(terminal.prompts()) << terminal.unseen();
    terminal.type("20 + 22x\x7f\r");
    EXPECT_TRUE(terminal.sees("\r42\r\n") && terminal.prompts()) << terminal.unseen();
    terminal.type("for i = 7, 7 do\r");
    EXPECT_TRUE(terminal.sees(">> ")) << terminal.unseen();
    terminal.type("print(i * 11)\rend\r");
    EXPECT_TRUE(terminal.sees("\r77\r\n") && terminal.prompts()) << terminal.unseen();
    terminal.type(kCtrlD);
    EXPECT_EQ(terminal.end(), 0);
  }
  Terminal again(place.folder());
  ASSERT_TRUE(again.prompts());
  again.type(std::string(kUp) + "\r");
  EXPECT_TRUE(again.sees("\r77\r\n") && again.prompts())
      << "three lines, one statement: " << again.unseen();
  again.type(std::string(kUp) + kUp + "\r");
  EXPECT_TRUE(again.sees("\r42\r\n")) << again.unseen();
}

TEST(TerminalPrompt, TabCompletesRolesMethodsOptionsAndTheirValues) {
  const Workplace place;
  Terminal terminal(place.folder());
  ASSERT_TRUE(terminal.prompts());
  terminal.type("rig.top\t");
  EXPECT_TRUE(terminal.sees("rig.top_camera")) << terminal.unseen();
  terminal.type(":gr\t");
  EXPECT_TRUE(terminal.sees(":grab")) << terminal.unseen();
  terminal.type("?\r");
  EXPECT_TRUE(terminal.sees("waits for the next frame")) << terminal.unseen();
  terminal.type("rig:servo { feed\t");
  EXPECT_TRUE(terminal.sees("feedback = ")) << terminal.unseen();
  terminal.type("\"two\t");
  EXPECT_TRUE(terminal.sees("two_cameras")) << terminal.unseen();
  terminal.type(std::string(kCtrlC) + "control.rob\t\t\t");
  EXPECT_TRUE(terminal.sees("control.robots")) << terminal.unseen();
  terminal.type(std::string(kCtrlC) + "run(\"hello\t");
  EXPECT_TRUE(terminal.sees("hello_rig")) << terminal.unseen();
}

TEST(TerminalPrompt, CtrlCStopsWhatRunsAndKeepsTheSession) {
  const Workplace place;
  Terminal terminal(place.folder());
  ASSERT_TRUE(terminal.prompts());
  terminal.type("x = 5\rprint('wai' .. 'ting') run:wait(1000)\r");
  ASSERT_TRUE(terminal.sees("waiting")) << terminal.unseen();
  terminal.type(kCtrlC);
  EXPECT_TRUE(terminal.sees("stopped") && terminal.prompts()) << terminal.unseen();
#ifndef __SANITIZE_THREAD__  // it keeps signals back until a call that blocks; this loop has none
  terminal.type("print('bu' .. 'sy') while true do end\r");
  ASSERT_TRUE(terminal.sees("busy")) << terminal.unseen();
  terminal.type(kCtrlC);
  EXPECT_TRUE(terminal.sees("stopped") && terminal.prompts()) << terminal.unseen();
#endif
  terminal.type(std::string("half a line (") + kCtrlC);
  EXPECT_TRUE(terminal.sees("^C") && terminal.prompts()) << terminal.unseen();
  terminal.type("x * 3\r");
  EXPECT_TRUE(terminal.sees("\r15\r\n")) << "what was there before is there: " << terminal.unseen();
}

TEST(TerminalPrompt, WhatIsPrintedTakesTheProgressAwayAndWatchingAServoIsALineALook) {
  const Workplace place;
  Terminal terminal(place.folder());
  ASSERT_TRUE(terminal.prompts());
  terminal.type("run('hello_rig')\r");
  EXPECT_TRUE(terminal.sees("100 %") && terminal.prompts()) << terminal.unseen();
  EXPECT_NE(terminal.screen().find(" \rframe_period                 66.7 ms"), std::string::npos)
      << terminal.screen();
  terminal.type("watch(rig:servo { feedback = 'pose_sensor' }, { count = 1 })\r");
  EXPECT_TRUE(terminal.sees("position \u2013  ") && terminal.sees("state \"") &&
              terminal.sees("target {0, 0, 0} mm") && terminal.prompts())
      << "nothing is seen yet: " << terminal.unseen();
  EXPECT_EQ(terminal.screen().find("headroom = "), std::string::npos) << terminal.screen();
}

TEST(TerminalPrompt, WhatIsSaidMeanwhileStandsAboveTheLineThatIsTyped) {
  const Workplace place;
  Terminal terminal(place.folder());
  ASSERT_TRUE(terminal.prompts());
  terminal.type("drops = run:remind('moisten the eye', { every = 1 * s })\r20 +");
  ASSERT_TRUE(terminal.sees("20 +"));
  EXPECT_TRUE(terminal.sees("moisten the eye")) << terminal.unseen();
  EXPECT_TRUE(terminal.sees("20 +")) << "the line is drawn again: " << terminal.unseen();
  terminal.type(" 22\r");
  EXPECT_TRUE(terminal.sees("\r42\r\n")) << terminal.unseen();
}

TEST(TerminalPrompt, APastedFileIsOneStatement) {
  const Workplace place;
  Terminal terminal(place.folder());
  ASSERT_TRUE(terminal.prompts());
  std::string text = "\x1b[200~";
  for (int i = 0; i < 100; ++i) text += "y = " + std::to_string(i) + " -- a line of it\n";
  terminal.type(text + "print(y + 1)\x1b[201~\r");
  EXPECT_TRUE(terminal.sees("\r100\r\n")) << terminal.unseen();
}

TEST(PipedPrompt, ErrorsNameTheLineOfTheFileAndMakeTheExitCodeOne) {
  const Workplace place;
  const Spoken spoken =
      place.vitreo("", "print('first')\n\nx = {\n  1,\n  nil + 1,\n}\nprint('last')\n");
  EXPECT_EQ(spoken.exit_code, 1);
  EXPECT_EQ(spoken.out, "first\nlast\n");
  EXPECT_NE(spoken.err.find("prompt:5: attempt to perform arithmetic on a nil value\n    nil + 1,"),
            std::string::npos)
      << spoken.err;
  EXPECT_EQ(place.vitreo("", "1 + 1\n").exit_code, 0);
}

TEST(PipedPrompt, AProtocolRunsByNameWithItsParametersAndEndsWithTheStatement) {
  const Workplace place;
  std::filesystem::create_directories(place.folder() / "protocols");
  std::filesystem::create_directories(place.folder() / "scripts/rigs");
  std::filesystem::copy(VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua",
                        place.folder() / "scripts/rigs");
  place.write("protocols/push.lua",
              "return { title = 'push', needs = { 'coils' }, parameters = {\n"
              "  current = { default = 1, unit = 'A', max = 5 }, kind = { default = 'a', choices = "
              "{ 'a', 'b' } } },\n"
              "run = function(rig, p, run)\n"
              "  run:defer(function() rig.coils:set_currents { 0, 0, 0, 0, 0, 0, 0, 0 } end)\n"
              "  rig.coils:set_currents { p.current, 0, 0, 0, 0, 0, 0, 0 }\n"
              "  run:result('current', rig.coils:currents()[1], 'A')\n"
              "  if p.kind == 'b' then error('on purpose') end\nend }\n");
  const Spoken spoken = place.vitreo(
      "",
      "run('push', {current = 2*A})\nrig.coils:currents()[1]\nrun('push', {current = 9*A})\n"
      "run('push', {curent = 1})\nrun('pusch')\nrun('push', {kind = 'b'})\n"
      "rig.coils:currents()[1]\nrun('push', {current = '3um'})\n");
  EXPECT_EQ(spoken.out,
            "current                      2 A\n0.0\ncurrent                      1 A\n0.0\n")
      << spoken.err;
  for (const char* words :
       {"current: wants at most 5 A, got 9 A", "curent is not known; did you mean current?",
        "there is no protocol 'pusch'; did you mean push?", "push.lua:7: on purpose",
        "current: wants a current"})
    EXPECT_NE(spoken.err.find(words), std::string::npos) << words << " in " << spoken.err;
}

// A night of measurements goes on after one that failed: its protocol has ended, with what it put
// off, before pcall() returns.
TEST(PipedPrompt, AProtocolThatFailedAndWasCaughtHasEnded) {
  const Workplace place;
  std::filesystem::create_directories(place.folder() / "protocols");
  std::filesystem::create_directories(place.folder() / "scripts/rigs");
  std::filesystem::copy(VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua",
                        place.folder() / "scripts/rigs");
  place.write("protocols/fails.lua",
              "return { title = 'fails', run = function(rig, p, run)\n"
              "  run:defer(function() run:wait(0.1) print('put off') end)\n"
              "  run:wait(0.1)\n  error('on purpose', 0)\nend }\n");
  const Spoken spoken =
      place.vitreo("",
                   "do for i = 1, 2 do print(pcall(run, 'fails')) end print('after') end\n"
                   "run('fails')\nprint('last')\n");
  const std::string once = "put off\nfalse\ton purpose\n";
  EXPECT_EQ(spoken.out, once + once + "after\nput off\nlast\n") << spoken.err;
  EXPECT_NE(spoken.err.find("fails.lua:4"), std::string::npos) << spoken.err;
}

TEST(PipedPrompt, EachProtocolShowsItsOwnResults) {
  const Workplace place;
  std::filesystem::create_directories(place.folder() / "protocols");
  std::filesystem::create_directories(place.folder() / "scripts/rigs");
  std::filesystem::copy(VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua",
                        place.folder() / "scripts/rigs");
  for (const std::string name : {"one", "two"})
    place.write("protocols/" + name + ".lua", "return { title = '" + name +
                                                  "', run = function(rig, p, run) run:result('" +
                                                  name + "', 1) end }");
  EXPECT_EQ(place.vitreo("", "run('one')\nrun('two')\nrun('one')\n").out,
            "one                          1\ntwo                          1\none                   "
            "       1\n");
}

TEST(PipedPrompt, CheckDriesAProtocolAndTouchesNothing) {
  const Workplace place;
  std::filesystem::create_directories(place.folder() / "protocols");
  std::filesystem::create_directories(place.folder() / "scripts/rigs");
  std::filesystem::copy(VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua",
                        place.folder() / "scripts/rigs");
  place.write("protocols/push.lua",
              "return { title = 'push', needs = { 'coils' }, parameters = {\n"
              "  current = { default = 1, unit = 'A', max = 5 }, note = { default = '' } },\n"
              "run = function(rig, p, run)\n"
              "  rig.coils:set_currents { p.current, 0, 0, 0, 0, 0, 0, 0 }\n"
              "  run:wait(2)\n  rig.coils:set_currents { 0, 0, 0, 0, 0, 0, 0, 0 }\n"
              "  if p.note ~= '' then error('noted: ' .. p.note) end\nend }\n");
  const Spoken spoken =
      place.vitreo("",
                   "check('push', {current = 1.25*A})\n"
                   "check('push', {note = 'a b \\'c\\''})\n"
                   "rig.coils:currents()[1]\nrun:now() < 0.1\ncheck('push', {current = 9*A})\n"
                   "check('push', {curent = 1})\ncheck('pusch')\ncheck('push', 5)\ncheck()\n");
  EXPECT_EQ(spoken.exit_code, 1);
  for (const char* words : {"coils: up to 1.25 A in one", "disk: at least", "passed\ntrue\n",
                            "problem: ", "noted: a b 'c'", "failed\nfalse\n0.0\ntrue\n"})
    EXPECT_NE(spoken.out.find(words), std::string::npos) << words << " in " << spoken.out;
  for (const char* words :
       {"check: current: wants at most 5 A, got 9 A", "curent is not known; did you mean current?",
        "there is no protocol 'pusch'; did you mean push?",
        "parameters: wants a table, got a number", "protocol: is missing"})
    EXPECT_NE(spoken.err.find(words), std::string::npos) << words << " in " << spoken.err;
  EXPECT_EQ(place.runs(), 1) << "the dry runs leave no record";
}

TEST(TerminalPrompt, CtrlCEndsACheckAndKeepsTheSession) {
  const Workplace place;
  const std::string hangs = place.write(
      "hangs.lua", "return { title = 'hangs', run = function() while true do end end }\n");
  Terminal terminal(place.folder());
  ASSERT_TRUE(terminal.sees("> "));
  terminal.type("print('loo' .. 'king') check('" + hangs + "')\r");
  ASSERT_TRUE(terminal.sees("looking")) << terminal.unseen();
  terminal.type(kCtrlC);
  EXPECT_TRUE(terminal.sees("stopped")) << terminal.unseen();
  terminal.type("6 * 7\r");
  EXPECT_TRUE(terminal.sees("\r42\r\n")) << terminal.unseen();
}

TEST(PipedPrompt, AHandleSaysWhatCanBeAskedOfIt) {
  const Workplace place;
  const std::string said = place.vitreo("", "rig\nrig.lens_mover\n").out;
  EXPECT_TRUE(said.starts_with("rig: coils lens_mover pose_sensor")) << said;
  EXPECT_NE(said.find("\nlens_mover: "), std::string::npos) << said;
  EXPECT_NE(said.find(" home"), std::string::npos) << said;
}

TEST(PipedPrompt, TablesAreShownInPeoplesUnits) {
  const Workplace place;
  const std::string said =
      place.vitreo("", "rig.top_camera:info()\nrig:model()\nrig.top_camera:info().frame_period\n")
          .out;
  for (const char* part :
       {"effective_pixel = 14.3 \u00b5m,", "frame_period = 66.6667 ms,", "width_px = 1384,",
        "eye_in_world = {0, 0, -5} mm,", "focus = 12.3 mm, numerical_aperture = 0.01,"})
    EXPECT_NE(said.find(part), std::string::npos) << part << " in " << said;
}

TEST(PipedPrompt, LongAndOpenEndedInputIsRefusedNotSwallowed) {
  const Workplace place;
  EXPECT_EQ(place.vitreo("", "x = '" + std::string(10'000'000, 'y') + "'\n#x\n").out, "10000000\n");
  std::string open = "x = [[\n";
  for (int i = 0; i < 30000; ++i) open += "junk junk junk junk\n";
  const Spoken spoken = place.vitreo("", open + "print('never')\n");
  EXPECT_EQ(spoken.exit_code, 1);
  EXPECT_NE(spoken.err.find("what began on line 1 is still open after"), std::string::npos)
      << spoken.err.substr(0, 300);
}

// The goal of issue 24: grab, look, track, fit and plot in at most ten lines, without leaving the
// terminal.
TEST(TerminalPrompt, GrabLookTrackFitAndPlotTakeTenLines) {
  const Workplace place;
  setenv("VITREO_GRAPHICS", "braille", 1);
  Terminal terminal(place.folder(), "--seed 3", 100);
  unsetenv("VITREO_GRAPHICS");
  EXPECT_TRUE(terminal.sees("record in ")) << "the banner names rig and folder";
  ASSERT_TRUE(terminal.prompts()) << terminal.unseen();
  const auto enter = [&terminal](const std::string& line, const std::string& shown) {
    terminal.type(line + "\r");
    EXPECT_TRUE(terminal.sees(shown, std::chrono::seconds(60)))
        << line << ": " << terminal.unseen();
    EXPECT_TRUE(terminal.prompts()) << line << ": " << terminal.unseen();
  };
  enter("image = rig.top_camera:grab().image; show(image)",
        "\xe2\xa2");  // how U+2880 to U+28BF begin: Braille
  enter("background = rig:learn_background { frames = 15 }", "");
  enter("rig.sample:insert_robot(vector(0, 0, 0))", "");
  enter("servo = rig:servo { background = background, field = 10 * mT }", "");
  enter("start = run:now(); servo:hold(vector(0, 0, 0)); run:wait(2 * s)", "");
  enter("seen = run:samples('servo', { 'x' }, { from = start })", "");
  enter("found = fit.line(seen.time, seen.x)", "");
  enter("found.slope_sigma > 0", "true");
  enter("plot(seen.time, { seen.x, found.y }, { x = { 'time', 's' }, y = { 'x', 'um' } })",
        "x (\u00b5m)");
  terminal.type("exit\r");
  EXPECT_EQ(terminal.end(), 0);
}

// To repeat a protocol is what a prompt is for: one record, and none is left over from the one
// before.
TEST(PipedPrompt, RunsFiveHundredProtocolsInOneStatement) {
  const Workplace place;
  const Spoken said = place.vitreo("--out runs",
                                   "for i = 1, 500 do run('hello_rig', { frames = 1 }) end\n"
                                   "print('all of them')\n");
  EXPECT_EQ(said.exit_code, 0) << said.err;
  EXPECT_NE(said.out.find("all of them"), std::string::npos) << said.err;
  EXPECT_EQ(said.err.find("runs already"), std::string::npos);
  EXPECT_EQ(place.runs(), 1);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
