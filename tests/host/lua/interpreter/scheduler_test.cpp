// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

using Waiting = LuaBench;

TEST_F(Waiting, AWaitPassesVirtualTime) {
  ASSERT_EQ(run("run:wait(3600) assert(run:now() == 3600)").error, "");
  EXPECT_EQ(to_seconds(clock->now()), 3600);
}

TEST_F(Waiting, AWaitWorksInsidePcallIteratorsMetamethodsAndCoroutines) {
  EXPECT_EQ(run("local ok, a, b = pcall(function() run:wait(1) return 4, 5 end) assert(ok and a == "
                "4 and b == 5)")
                .error,
            "");
  EXPECT_EQ(run("local ok, why = pcall(function() run:wait(1) error('x', 0) end) assert(not ok and "
                "why == 'x')")
                .error,
            "");
  EXPECT_EQ(run("local ok, a = xpcall(function(n) run:wait(1) return n end, print, 9) assert(ok "
                "and a == 9)")
                .error,
            "");
  EXPECT_EQ(run("local ok, why = xpcall(function() run:wait(1) error('x', 0) end, function(e) "
                "return e .. '!' end)\n"
                "assert(not ok and why == 'x!')")
                .error,
            "");
  EXPECT_EQ(run("local start = run:now()\nlocal seen = {}\n"
                "for x in coroutine.wrap(function() for i = 1, 3 do run:wait(1) coroutine.yield(i) "
                "end end) do "
                "seen[#seen + 1] = x end\n"
                "assert(#seen == 3 and run:now() - start == 3)")
                .error,
            "");
  EXPECT_EQ(run("local outer = coroutine.create(function()\n local inner = "
                "coroutine.create(function(a) run:wait(1) local b "
                "= coroutine.yield(a) run:wait(1) return b end)\n"
                "local _, one = coroutine.resume(inner, 1) local _, two = coroutine.resume(inner, "
                "2) return one + two end)\n"
                "local ok, sum = coroutine.resume(outer) assert(ok and sum == 3 and "
                "coroutine.status(outer) == 'dead')")
                .error,
            "");
  EXPECT_EQ(run("local t = setmetatable({}, { __index = function(_, k) run:wait(1) return k end }) "
                "assert(t.x == 'x')")
                .error,
            "");
}

TEST_F(Waiting, AWaitWhereLuaCannotSuspendIsANamedError) {
  const std::string wanted = "run:wait: cannot wait here";
  expect_all(run("table.sort({3, 2, 1}, function(a, b)\nrun:wait(1) return a < b end)").error,
             {"p.lua:3:", wanted, "table.sort"});
  expect_all(run("('x'):gsub('x', function() run:wait(1) end)").error, {"p.lua:2:", wanted});
  expect_all(run("table.sort({2, 1}, function(a, b) local ok, why = "
                 "coroutine.resume(coroutine.create(function() "
                 "run:wait(1) end))\n"
                 "error(why, 0) end)")
                 .error,
             {"cannot wait here", "resumed inside"});
  EXPECT_EQ(run("local ok, why = pcall(table.sort, {2, 1}, function() run:wait(1) end) assert(not "
                "ok) run:wait(1)")
                .error,
            "");
}

TEST_F(Waiting, BlockingCallsRunAsideOfTheScript) {
  EXPECT_EQ(run("local start = run:now()\nlocal a = rig.top_camera:grab() local b = "
                "rig.top_camera:grab()\n"
                "assert(b.number == a.number + 1 and math.abs(b.time - a.time - 0.1) < 1e-9 and "
                "a.width_px == 10)\n"
                "rig.lens_mover:move_to(1e-3) assert(rig.lens_mover:position() == 1e-3)\n"
                "rig.coils:set_currents({1, 2, 3, 4, 5, 6, 7, 8}) assert(rig.coils:currents()[8] "
                "== 8 and "
                "rig.coils:info().limit == 12)")
                .error,
            "");
  EXPECT_EQ(coils.currents()[2], 3);
}

TEST_F(Waiting, DeviceErrorsCanBeCaughtByKind) {
  camera.silent = true;
  ASSERT_EQ(run("local ok, why = pcall(rig.top_camera.grab, rig.top_camera, { timeout = 1 })\n"
                "assert(not ok and why.kind == 'timeout' and why.device == 'top_camera' and "
                "why.message:find('no frame'))\n"
                "print(tostring(why))")
                .error,
            "");
  expect_all(said(), {"p.lua:2:", "top_camera: no frame came", "(timeout)"});
}

TEST_F(Waiting, AnUncaughtDeviceErrorReachesTheHostAsOne) {
  const Ended refused = run("local c = {13, 0, 0, 0, 0, 0, 0, 0}\nrig.coils:set_currents(c)");
  EXPECT_TRUE(refused.device_error);
  expect_all(refused.error,
             {"coils: coil 1: 13 A is beyond the limit of 12 A", "p.lua:3 (refused)"});
}

TEST_F(Waiting, TasksRunSideBySideAndEndTogether) {
  EXPECT_EQ(
      run("local start, order = run:now(), ''\n"
          "run:together(function() run:wait(2) order = order .. 'b' rig.top_camera:grab() end,\n"
          "             function() run:wait(1) order = order .. 'a' rig.lens_mover:move_to(0) "
          "order = order .. "
          "'c' end)\n"
          "assert(order == 'abc' and run:now() - start == 3, order .. run:now())")
          .error,
      "");
  expect_all(run("local start = run:now()\nlocal closed = false\nlocal ok, why = pcall(function() "
                 "run:together(\n"
                 " function() local x <close> = setmetatable({}, {__close = function() "
                 "run:wait(0.5) closed = true "
                 "end}) run:wait(1000) end,\n"
                 " function() run:wait(1) error('mine') end) end)\n"
                 "assert(closed and run:now() - start == 1.5 and not ok)\nerror(why, 0)")
                 .error,
             {"p.lua:6: mine"});
  expect_all(run("run:together(5)").error, {"run:together: wants functions, got a number"});
}

TEST_F(Waiting, YieldingOutsideACoroutineIsAnError) {
  expect_all(run("coroutine.yield(1)").error, {"outside a coroutine"});
  EXPECT_EQ(run("local co = coroutine.wrap(function() error('x', 0) end) local ok, why = pcall(co) "
                "assert(why == 'x')")
                .error,
            "");
  EXPECT_EQ(
      run("local co = coroutine.create(function() coroutine.yield() end) coroutine.resume(co) "
          "assert(coroutine.close(co))\n"
          "local ok, why = coroutine.resume(co) assert(not ok and why:find('dead'))")
          .error,
      "");
}

TEST_F(Waiting, EachKeepsTheProgress) {
  ASSERT_EQ(run("for place in run:each({ 'a', 'b' }, 'place') do\n for turn in run:each(2, 'turn') "
                "do\n run:wait(1) end end\n"
                "for _ in run:each(4, 'left early') do break end\nrun:progress(0.5, 'half')")
                .error,
            "");
  EXPECT_EQ(listener.labels.front(), "place 1 of 2");
  const std::vector<double> wanted = {0, 0, 0.25, 0.5, 0.5, 0.5, 0.75, 1, 1, 0, 0.5};
  ASSERT_EQ(listener.fractions.size(), wanted.size());
  for (std::size_t i = 0; i < wanted.size(); ++i)
    EXPECT_NEAR(listener.fractions[i], wanted[i], 1e-12) << i;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
