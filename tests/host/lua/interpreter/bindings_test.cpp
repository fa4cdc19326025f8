// Errors and results of host calls from Lua, made wrongly and rightly.
// SPDX-License-Identifier: Apache-2.0
#include "host/runs/results_text.h"
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

using Bindings = LuaBench;

TEST_F(Bindings, WrongArgumentsNameFunctionArgumentAndWhatIsWanted) {
  expect_all(run("run:wait('long')").error,
             {"p.lua:2: run:wait: duration: wants a number in s, got a string"});
  expect_all(run("run:wait()").error, {"run:wait: duration: is missing; wants a number in s"});
  expect_all(run("run:wait(-1)").error, {"run:wait: duration: wants 0 to", "got -1 s"});
  expect_all(run("run:wait(0/0)").error, {"run:wait: duration: wants a number in s"});
  expect_all(run("run:wait(1/0)").error, {"run:wait: duration: wants"});
  expect_all(run("run:wait(1, 2)").error, {"run:wait: takes (duration), got 2 arguments"});
  expect_all(run("run.wait(1)").error,
             {"run:wait: is called with a colon, on a run: run:wait(duration)"});
  expect_all(run("run.wait(rig, 1)").error, {"is called with a colon, on a run"});
  expect_all(run("rig.top_camera:grab { timout = 1 }").error,
             {"camera:grab: timout is not known; did you mean timeout?"});
  expect_all(run("rig.top_camera:grab { timeout = 'x' }").error,
             {"camera:grab: timeout: wants a number in s, got a string"});
  expect_all(run("rig.top_camera:grab { 5 }").error, {"camera:grab: 1 is not known"});
  expect_all(run("rig.coils:set_currents({ 1, 'x' })").error,
             {"coils:set_currents: currents[2]: wants a number in A, got a string"});
  expect_all(run("rig.coils:set_currents({ 1, 2 })").error, {"coils:set_currents: "});
  expect_all(run("rig:servo { background = rig }").error,
             {"rig:servo: background: wants a background, got a rig"});
  expect_all(run("rig:servo {}").error,
             {"rig:servo: feedback \"one_camera\" needs a background of the empty scene"});
  expect_all(run("rig:servo { feild = 1 }").error,
             {"rig:servo: feild is not known; did you mean field?"});
  expect_all(run("run:each('x')").error, {"run:each: list: wants a list or a whole number"});
  expect_all(run("run:each(1.5)").error, {"run:each: list: wants a list or a whole number"});
  expect_all(run("run:defer(5)").error, {"run:defer: clean_up: wants a function, got a number"});
}

TEST_F(Bindings, UnknownMembersGetASuggestionAndAbsentRolesAreNil) {
  expect_all(run("rig.top_camra:grab()").error,
             {"p.lua:2: rig has no top_camra; did you mean top_camera?"});
  expect_all(run("run:wiat(1)").error, {"run has no wiat; did you mean wait?"});
  expect_all(run("run.name = 5").error, {"nothing can be set on a run"});
  EXPECT_EQ(run("assert(rig.sample == nil and rig.side_camera == nil and rig.coils)").error, "");
  EXPECT_EQ(run("assert(getmetatable(rig) == 'rig')").error, "");
}

TEST_F(Bindings, PositionsHaveArithmetic) {
  EXPECT_EQ(run("local a, b = vector(1, 2, 3), vector { 4, 6, 3 }\nassert(b - a == vector(3, 4, 0) "
                "and (b - a):norm() == 5)\n"
                "assert(2*a == a*2 and a/2 == vector(0.5, 1, 1.5) and -a == a*-1 and a.x == 1 and "
                "a[3] == 3 and #a == 3)\n"
                "assert(a + {1, 1, 1} == vector(2, 3, 4) and a:dot(b) == 25) a.z = 9 assert(a[3] "
                "== 9 and a.w == nil)")
                .error,
            "");
  expect_all(run("return vector(1, 2, 3) + 1").error,
             {"p.lua:2: vector: wants a vector {x, y, z}, got a number"});
  expect_all(run("return vector(1, 2)").error, {"vector: wants a number, got nothing"});
  expect_all(run("local v = vector(1, 2, 3) v.w = 1").error, {"only x, y and z can be set"});
}

TEST_F(Bindings, SamplesGoIntoAStreamAndComeBack) {
  ASSERT_EQ(run("for i = 1, 3 do run:record('drift', { speed = i, place = vector(i, 0, -i) }, { "
                "speed = 'm/s', place = "
                "'mm' }) run:wait(1) end\n"
                "local all = run:samples('drift')\nassert(#all.place_z == 3 and all.place_z[2] == "
                "-2 and all.time[3] == 2 and all.speed[1] == 1)\n"
                "local part = run:samples('drift', { 'speed' }, { from = 1, to = 1.5 })\n"
                "assert(#part.speed == 1 and part.speed[1] == 2 and part.time[1] == 1 and "
                "part.place_x == nil)\n"
                "assert(#run:samples('drift', {}).time == 3 and run:samples('truth') == nil)")
                .error,
            "");
  const Stream& stream = *recorder.stream("drift");
  ASSERT_EQ(stream.info.channels.size(), 4u);
  EXPECT_EQ(stream.info.channels[0].name, "place_x");
  EXPECT_EQ(stream.info.channels[0].unit, "m");
  EXPECT_EQ(stream.info.channels[3].unit, "m/s");
  expect_all(run("run:samples('drift', { 'sped' })").error,
             {"run:samples: channels: the stream drift has no sped; it has place_x, place_y, "
              "place_z, speed"});
  expect_all(run("run:samples('drift', { 1 })").error,
             {"run:samples: channels: entry 1: wants a name, got a number"});
  expect_all(run("run:record('e', { time = 1 })").error,
             {"values: time: is kept for every sample"});
  expect_all(run("run:record('drift', { speed = 1 })").error, {"drift is recorded by the host"});
  expect_all(run("run:record('a', { x = 1 }) run:record('a', { y = 1 })").error,
             {"run:record: values: y was not in the first sample of a"});
  expect_all(run("run:record('b', { x = 1, y = 1 }) run:record('b', { y = 1 })").error,
             {"values: x is missing"});
  expect_all(run("run:record('c', { place = 'here' })").error,
             {"values: place: wants a number or a position", "got a string"});
  expect_all(run("run:record('c', {})").error, {"wants names and numbers"});
}

TEST_F(Bindings, ErrorsOfOneStreamAgainstAnother) {
  ASSERT_EQ(run("for i = 1, 4 do run:record('a', { x = i, y = 0, z = 0 }) run:record('b', { x = i, "
                "y = 3e-3, z = 4e-3 "
                "}) run:wait(1) end\n"
                "local e = run:errors { of = 'a', against = 'b' }\nassert(e.count == 4 and "
                "math.abs(e.rms - 5e-3) < "
                "1e-12 and math.abs(e.depth_max - 4e-3) < 1e-12)")
                .error,
            "");
  expect_all(run("for i = 1, 3 do run:record('c', { x = i, y = 0, z = 0 }) run:wait(1) end\n"
                 "for i = 1, 3 do run:record('d', { x = i, y = 0, z = 0 }) run:wait(1) end\n"
                 "run:errors { of = 'c', against = 'd' }")
                 .error,
             {"p.lua:4: run:errors: nothing to compare", "'c' and 'd'"});
  expect_all(run("run:errors { of = 'nothing', against = 'a' }").error,
             {"p.lua:2: run:errors: ", "nothing"});
  expect_all(run("run:errors { off = 'a' }").error, {"off is not known; did you mean of"});
}

TEST_F(Bindings, AResultInPercentKeepsItsUnit) {
  ASSERT_EQ(run("run:result('tracked', 0.125, '%') run:result('gain', 2)").error, "");
  const std::vector<StatedResult>& results = recorder.results();
  EXPECT_DOUBLE_EQ(results.at(0).value, 0.125) << "the ratio itself";
  EXPECT_EQ(results.at(0).unit, "%");
  EXPECT_EQ(results.at(1).unit, "");
  EXPECT_EQ(results_text(results).substr(0, results_text(results).find('\n')),
            "tracked                      12.5 %");
}

TEST_F(Bindings, ResultsGoIntoTheRecord) {
  ASSERT_EQ(
      run("run:result('error', 0.00012, 'um')\n"
          "run:plot { title = 'P', x = { 'time', 's' }, y = { label = 'error', unit = 'um' }, "
          "equal_aspect = true,\n"
          "  series = { { label = 'a', x = { 1, 2 }, y = { 3, 4 }, mark = 'dashed' }, { x = {}, y "
          "= {} } } }\n"
          "run:table { title = 'T', header = { 'a', 'b' }, rows = { { 'x', 1 }, { 'y', 2.5 } } }\n"
          "run:note('seen') run:checkpoint('here')\nassert(format_quantity(0.00012, 'm') == '120 "
          "\u00b5m')")
          .error,
      "");
  EXPECT_EQ(recorder.results().at(0).name, "error");
  EXPECT_DOUBLE_EQ(recorder.results().at(0).value, 0.00012);
  EXPECT_EQ(recorder.results().at(0).unit, "m");
  const Plot& plot = recorder.plots().at(0);
  EXPECT_EQ(plot.y.unit, "um");
  EXPECT_TRUE(plot.equal_aspect);
  EXPECT_EQ(plot.series.at(0).mark, Mark::dashed);
  EXPECT_EQ(recorder.tables().at(0).rows.at(1).at(1), "2.5");
  EXPECT_EQ(said(), "seen");
  EXPECT_EQ(recorder.events().back().kind, "checkpoint");
}

TEST_F(Bindings, WrongResultsAreRefused) {
  expect_all(run("run:result('e', 0/0, 'm')").error, {"run:result: value: wants a number"});
  expect_all(run("run:result('e', 1, 'umm')").error,
             {"run:result: unit: umm is not a unit; did you mean mm?"});
  const auto plot = [&](const std::string& series) {
    return run("run:plot { title = 'P', x = { 'time', 's' }, y = { 'e', 'um' }, series = { " +
               series + " } }")
        .error;
  };
  expect_all(plot("{ x = { 1 }, y = { 1, 2 } }"), {"run:plot: series 1: x has 1 numbers, y has 2"});
  expect_all(plot("{ x = { 1 }, y = { 'a' } }"), {"series 1: y: wants a list of numbers"});
  expect_all(plot("{ x = { 1 }, y = { 1 }, mark = 'dots' }"),
             {"series 1: mark: wants line, dashed or points"});
  expect_all(plot("{ x = { 1 }, y = { 1 }, lable = 'x' }"),
             {"series 1: lable is not known; did you mean label?"});
  expect_all(run("run:plot { title = 'P' }").error, {"run:plot: x: is missing"});
  expect_all(run("run:table { title = 'T', header = { 'a' }, rows = { { 1, 2 } } }").error,
             {"row 1: has 2 cells, the header has 1"});
}

TEST_F(Bindings, ParametersArriveInSi) {
  EXPECT_EQ(run("assert(p.speed == 0.5e-3 and math.type(p.laps) == 'integer' and p.mode == 'a' and "
                "p.on == true)",
                "{ speed = { default = 0.5e-3, unit = 'mm/s' }, laps = { default = 2, integer = "
                "true }, mode = { "
                "default = 'a' }, on = { default = true } }")
                .error,
            "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
