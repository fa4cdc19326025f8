// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

using Prompt = LuaBench;

TEST_F(Prompt, ShowsWhatExpressionsAreWorth) {
  EXPECT_EQ(prompt("1 + 1\n'a', nil\nx = 5\nx * 2\n"), "2\n\"a\"\tnil\n10\n");
  EXPECT_EQ(prompt("{ 1, 2, a = { b = { c = { d = 1 } } } }\n"), "{1, 2, a = {b = {c = {...}}}}\n");
  EXPECT_EQ(prompt("vector(1, 2, 3) * 2\nprint\n"), "{2, 4, 6}\nfunction\n");
  EXPECT_TRUE(prompt("rig\n").starts_with("rig: coils lens_mover top_camera "))
      << "what can be asked of a handle";
  EXPECT_EQ(prompt("print('said')\nunits.mm\n\n   \n-- nothing\n"), "said\n0.001\n");
}

TEST_F(Prompt, ContinuesWhatIsNotComplete) {
  EXPECT_EQ(prompt("for i = 1, 2 do\nprint(i)\nend\n"), "1\n2\n");
  EXPECT_EQ(prompt("for i = 1, 2 do\nprint(i)\n", true).substr(0, 8), "> >> >> ");
  expect_all(prompt("function f(\n"), {"error: ", "near <eof>"});
}

TEST_F(Prompt, ErrorsDoNotEndIt) {
  const std::string out =
      prompt("error('oops')\nrun:wait('x')\nx = = 1\nundefined_thing\nerror({})\n2 + 2\n");
  expect_all(out,
             {"oops\n", "run:wait: duration: wants a number in s, got a string",
              "error: prompt:3: unexpected symbol", "undefined_thing is not defined", "\n4\n"});
}

TEST_F(Prompt, KnowsTheRigAndWaits) {
  EXPECT_EQ(
      prompt(
          "rig.top_camera:info().width_px\nrun:wait(2)\nrun:now()\nrig.top_camera:grab().number\n"),
      "10\n2 s\n1\n");
}

TEST_F(Prompt, AStopEndsTheStatementOnly) {
  const auto finger = clock->spawn("finger", [this] {
    clock->sleep_until(from_seconds(3));
    clock->interrupt();
  });
  EXPECT_EQ(prompt("run:wait(10)\n1\n"), "stopped\n1\n");
}

TEST_F(Prompt, AStopByAnotherMakesSafeAndSaysWhatIsNot) {
  std::vector<std::string> failures;
  int made_safe = 0;
  session.control.attach({[this] {
                            engine->interrupt();
                            clock->interrupt();
                          },
                          [&] {
                            ++made_safe;
                            return failures;
                          }});
  EXPECT_EQ(prompt("run:stop('enough')\n1\n"), "stopped\n1\n");
  EXPECT_EQ(made_safe, 0) << "the script meant its statement";
  for (const char* gone : {"", "coils: are gone"}) {
    if (*gone != '\0') failures = {gone};
    const auto hand = clock->spawn("hand", [this] {
      clock->sleep_for(from_seconds(3));
      session.control.request(StopTier::stop, "by Ann", {"person", "Ann"});
    });
    EXPECT_EQ(prompt("run:wait(10)\n1\n"), *gone != '\0'
                                               ? "stopped by Ann; not safe: coils: are gone\n1\n"
                                               : "stopped by Ann; the devices are safe\n1\n");
  }
  EXPECT_EQ(made_safe, 2);
  session.control.detach();
}

// Before 2026-11-30 that was told to none: the coils were at zero, and the next line found them so.
TEST_F(Prompt, ALoopThatEndsByItselfIsAnAlarmUnlessTheStatementHasToldOfIt) {
  const auto ends_at = [this](double seconds) {
    return clock->spawn("loop", [this, seconds] {
      clock->sleep_until(from_seconds(seconds));
      recorder.event(clock->now(), "servo failed", "its pictures repeat");
    });
  };
  const auto known = ends_at(3);
  EXPECT_EQ(prompt("run:wait(10) error('the servo failed: its pictures repeat')\n1\n").back(),
            '\n');
  EXPECT_TRUE(session.alarms.shown().empty()) << "an error said so";
  const auto unknown = ends_at(15);
  EXPECT_EQ(prompt("run:wait(10)\n1\n"), "1\n");
  ASSERT_EQ(session.alarms.shown().size(), 1U);
  const Alarm alarm = session.alarms.shown()[0];
  EXPECT_EQ(alarm.priority, AlarmPriority::high);
  EXPECT_EQ(alarm.times, 1) << "once";
  EXPECT_EQ(alarm.text, "the loop has ended: its pictures repeat; the coils are at zero");
  session.alarms.acknowledge("", "Ann");
  interlock.trip("a limit");
  const auto tripped = ends_at(25);
  EXPECT_EQ(prompt("run:wait(10)\n1\n"), "1\n");
  EXPECT_EQ(session.alarms.shown()[0].times, 1) << "the interlock has told of it";
}

TEST_F(Prompt, HelpComesFromTheBindings) {
  expect_all(prompt("help()\n"), {"servo: the servo loop", "run: this run", "units.mm"});
  expect_all(prompt("help('servo')\n"), {"servo:go_to(position, {speed, acceleration, within, "
                                         "settle, timeout, within_angle, direction, "
                                         "turn_speed})",
                                         "servo:close()"});
  expect_all(prompt("help(rig.coils)\n"), {"coils:set_currents(currents, {hold})"});
  expect_all(prompt("help('servo:go_to')\n"),
             {"within: a number in m, 1 \u00b5m to 10 mm, may be left out; how near is there"});
  expect_all(prompt("help('follow')\n"), {"servo:follow(path, "});
  expect_all(prompt("help('servoo')\n"),
             {"error: ", "nothing is called servoo; did you mean servo?"});
}

TEST_F(Prompt, AQuestionMarkIsShortForHelp) {
  expect_all(prompt("rig.lens_mover:position?\n"),
             {"lens_mover:position() -> number in m", "for instance: rig.lens_mover:position()"});
  expect_all(prompt("rig.coils?\ncontrol?\nunits.um?\nx = 5\nx?\n"),
             {"coils: the coil amplifiers", "control: a module", "a number: 1e-06", "a number: 5"});
  expect_all(
      prompt("string.format?\nwatch?\nrig.coils:curents?\n"),
      {"a function of Lua", "watch(object, {every, count})", "did you mean coils:currents?"});
}

TEST_F(Prompt, ResultsAreShownInTheUnitOfTheCallTheyComeFrom) {
  EXPECT_EQ(prompt("rig.lens_mover:move_to(2 * mm)\nrig.lens_mover:position()\n"
                   "rig.lens_mover:position() * 2\nx = rig.lens_mover:position()\nx\n_\n"),
            "2 mm\n0.004\n0.002\n0.002\n");
  EXPECT_EQ(prompt("rig.coils:set_currents { 1, 0.25, 0, 0, 0, 0, 0, 0 }\nrig.coils:currents()\n"),
            "{1.00, 0.25, 0.00, 0.00, 0.00, 0.00, 0.00, 0.00} A\n");
  EXPECT_EQ(prompt("5 * um\n3 * mm_per_s\ns = 'mine'\ns\n"), "5e-06\n0.003\n\"mine\"\n");
}

TEST_F(Prompt, ErrorsShowTheUsersLinesTheInnermostFirst) {
  write("lib/mine.lua", "return { f = function(x)\n  return x.y.z\nend }\n");
  const std::string out =
      prompt("mine = require 'mine'\nfunction g(x)\n  return mine.f(x) + 1\nend\nprint(g({}))\n");
  const std::size_t first = out.find(
                        "mine.lua:2: attempt to index a nil value (field 'y')\n    return x.y.z"),
                    second = out.find("mine.f(x) + 1");
  EXPECT_NE(first, std::string::npos) << out;
  EXPECT_NE(second, std::string::npos) << out;
  EXPECT_LT(first, second);
  EXPECT_NE(prompt_failed.find("1 statement(s) failed, the first: "), std::string::npos)
      << prompt_failed;
}

TEST_F(Prompt, WatchShowsWhatAnObjectTells) {
  EXPECT_EQ(prompt("watch(rig.lens_mover)\n"), "position 0 mm\n");
  EXPECT_EQ(prompt("watch(function() return 1 + 1 end, { count = 2, every = 3 })\nrun:now()\n"),
            "2\n2\n3 s\n");
  expect_all(prompt("watch(5)\nwatch(rig.lens_mover, { evry = 1 })\n"),
             {"wants an object such as rig.stage", "evry is not known"});
}

TEST_F(Prompt, BinaryJunkAndLongLinesAreOnlyErrors) {
  expect_all(prompt(std::string("\x1bLua\x00junk\n", 10) + "1\n"), {"error: ", "\n1\n"});
  EXPECT_EQ(prompt("x = '" + std::string(10'000'000, 'y') + "'\n#x\n"), "10000000\n");
}

TEST_F(Prompt, EveryBindingIsDocumented) {
  const std::string out = prompt(
      "help('run')\nhelp('rig')\nhelp('camera')\nhelp('lens_mover')\nhelp('sample')\nhelp('"
      "background')\n");
  EXPECT_EQ(out.find("error"), out.find("errors({of")) << out;
}

TEST_F(Prompt, ShowsImagesAndPlotsAsPlainTextWhereThereIsNoTerminal) {
  const std::string image = prompt("show(rig.top_camera:grab().image)\n");
  EXPECT_NE(image.find("\u2800"), std::string::npos) << "cells of Braille: " << image;
  EXPECT_EQ(image.find('\x1b'), std::string::npos) << "no escape sequences in a pipe";
  const std::string plot = prompt(
      "plot({ 0, 1, 2, 3 }, { { 0, 1e-6, 4e-6, 9e-6 }, { 0, 3e-6, 6e-6, 9e-6 } }, { title = "
      "'Error', "
      "x = { 'time', 's' }, y = { 'error', 'um' }, labels = { 'measured', 'line' } })\n");
  expect_all(plot, {"Error\n", "error (\u00b5m)\n", "8 \u2524", "time (s)", "measured", "line"});
  EXPECT_EQ(plot.find('\x1b'), std::string::npos);
  expect_all(prompt("plot({ 1, 2 }, { 1 })\nplot({ 1 }, 'x')\n"),
             {"plot: y has 1 numbers, x has 2", "plot: y: wants"});
}

TEST_F(Prompt, ListsOfTablesStandInColumns) {
  EXPECT_EQ(prompt("{ { name = 'a', n = 1 }, { name = 'long', n = 20 } }\n"),
            "n   name\n1   \"a\"\n20  \"long\"\n");
  EXPECT_EQ(prompt("{ { a = 1 }, { b = 1 } }\n"), "{{a = 1}, {b = 1}}\n") << "different fields";
}

TEST_F(Prompt, FollowShowsARowOfATableForEachOneThatIsRecorded) {
  const auto file = folder.path() / "counts.lua";
  std::ofstream(file)
      << "return { title = 'Counts', run = function(rig, p, run)\n"
         "  for i = 1, 4 do run:record('count', { n = i, far = i * 1e-6 }, { far = 'm' }) end\n"
         "end }\n";
  const std::string out = prompt("follow('" + file.string() + "')\nfollow?\n");
  expect_all(out, {"count", "far", "3 \u00b5m", "far (\u00b5m)", "follow(protocol, {parameters})"});
}

TEST_F(Prompt, HelpFindsCallsByTopic) {
  expect_all(prompt("help('plot')\n"), {"plot(x, y, "});
  expect_all(prompt("help('covarian')\n"), {"about covarian:", "localizer:locate: "});
  expect_all(prompt("help('xyzzy')\n"), {"nothing is called xyzzy"});
}

TEST_F(Prompt, ExitAndQuitLeaveUnlessTheyAreNamesOfOnesOwn) {
  EXPECT_EQ(prompt("1\nexit\n2\n"), "1\n");
  EXPECT_EQ(prompt("1\nquit()\n2\n"), "1\n");
  EXPECT_EQ(prompt("exit = 5\nexit\n2\n"), "5\n2\n");
}

TEST_F(Prompt, FitsTellParametersWithTheirSigmasAndLetErrorsThrough) {
  expect_all(
      prompt(
          "f = fit.line({ 0, 1, 2, 3 }, { 0.1, 0.9, 2.1, 2.9 })\nf.slope\nf.degrees_of_freedom\n"),
      {"0.96", "2"});
  expect_all(prompt("fit.custom(function(x, a, b) return a * x ^ b end, { 1, 2, 3, 4 }, { 2, 8, "
                    "18, 32 }, { 1, 1 })"
                    ".parameters\n"),
             {"{2.0, 2.0}"});
  expect_all(
      prompt("fit.custom(function(x, a) error('mine') end, { 1, 2, 3 }, { 1, 2, 3 }, { 1 })\n"
             "fit.custom(function(x, a) return 'x' end, { 1, 2, 3 }, { 1, 2, 3 }, { 1 })\n"
             "fit.line({ 1, 2 }, { 1, 2 })\n"),
      {"mine", "f: wants a number back, got a string", "x: wants more than 2 samples"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
