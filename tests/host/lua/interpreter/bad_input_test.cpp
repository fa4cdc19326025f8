// Errors of scripts, on purpose or by accident: docs/safety_bad_input.md names the case that each
// test shows.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

using BadInput = LuaBench;

TEST_F(BadInput, NumbersAsStringsAreNoNumbers) {
  expect_all(run("run:wait('3')").error, {"run:wait: duration: wants a number in s, got a string"});
  expect_all(run("rig.lens_mover:move_to('0x10')").error,
             {"lens_mover:move_to: position: wants a number in m"});
  expect_all(run("rig.coils:set_currents { '1', 1, 1, 1, 1, 1, 1, 1 }").error,
             {"currents[1]: wants a number in A, got a string"});
}

TEST_F(BadInput, WhatIsNotFiniteIsRefusedAndTinyNumbersAreZero) {
  for (const char* value : {"0/0", "1/0", "-1/0"}) {
    expect_all(run(std::string("rig.lens_mover:move_to(") + value + ")").error,
               {"position: wants a number"});
    expect_all(
        run(std::string("rig.coils:set_currents { ") + value + ", 0, 0, 0, 0, 0, 0, 0 }").error,
        {"currents: holds a number that is not finite"});
  }
  EXPECT_EQ(run("run:wait(-0.0) run:wait(5e-324) assert(run:now() == 0)").error, "");
}

TEST_F(BadInput, NumbersBeyondEveryRangeAreRefused) {
  expect_all(run("run:wait(math.maxinteger)").error, {"run:wait: duration: wants 0 to"});
  expect_all(run("run:wait(1e308)").error, {"run:wait: duration: wants"});
  expect_all(run("run:each(2^53 + 1)").error, {"run:each: list: wants a list or a whole number"});
  expect_all(run("rig:learn_background { frames = math.maxinteger }").error,
             {"rig:learn_background: frames: wants"});
  expect_all(run("rig:learn_background { frames = 2.5 }").error,
             {"frames: wants a whole number, got 2.5"});
  EXPECT_TRUE(run("rig.coils:set_currents { 1e308, 0, 0, 0, 0, 0, 0, 0 }").device_error)
      << "the interlock refuses";
}

TEST_F(BadInput, AHandleOfAnotherKindOrAFunctionOfAnotherClassIsRefused) {
  expect_all(run("rig.coils.set_currents(rig.lens_mover, {})").error,
             {"is called with a colon, on a coils"});
  expect_all(run("rig.lens_mover.position('a file')").error,
             {"is called with a colon, on a lens_mover"});
  EXPECT_EQ(run("kept = run:remind('x') kept:close() kept:close() print(kept)").error, "");
  EXPECT_EQ(said(), "closed reminder");
}

TEST_F(BadInput, TablesWithCyclesHolesAndBadMetamethodsAreRead) {
  expect_all(run("local t = {} t.timeout = t rig.top_camera:grab(t)").error,
             {"timeout: wants a number in s, got"});
  expect_all(run("local t = {} t[1] = t rig.coils:set_currents(t)").error,
             {"currents[1]: wants a number in A, got a table"});
  expect_all(run("rig.coils:set_currents { 1, nil, 3, 4, 5, 6, 7, 8 }").error, {"p.lua:2:"});
  expect_all(
      run("rig.top_camera:grab(setmetatable({}, { __index = function() error('from index') end }))")
          .error,
      {"from index"});
  expect_all(
      run("rig.top_camera:grab(setmetatable({}, { __index = function() coroutine.yield() end }))")
          .error,
      {"p.lua:2:"});
  expect_all(
      run("rig.top_camera:grab(setmetatable({}, { __index = function() run:wait(1) end }))").error,
      {"cannot wait here"});
  EXPECT_EQ(run("local t = {} t.t = t print(t, { t })").error, "");
}

TEST_F(BadInput, TextsThatAreHugeOrNoTextReachTheRecordWhole) {
  EXPECT_EQ(run("run:note(('x'):rep(10000000) .. ('x'):rep(10000000)) run:note('a\\0b') "
                "run:note('\\xff\\xfe \\27[2J')")
                .error,
            "");
  ASSERT_EQ(recorder.events().size(), 3u);
  EXPECT_EQ(recorder.events()[0].text.size(), 20000000u);
  expect_all(run("local t = {} for i = 1, 40 do t[i] = ('x'):rep(16000000) .. i end").error,
             {"not enough memory"});
}

TEST_F(BadInput, ScriptsWithMarksAndLineEndsOfOtherEditorsAreRead) {
  const std::string plain = "return { title = 't', run = function() end }";
  EXPECT_EQ(describe("\xEF\xBB\xBF" + plain).title, "t");
  EXPECT_EQ(describe("return {\r\n title = 't',\r\n run = function() end }\r\n").title, "t");
  const auto broken = [&](const std::string& text) { return ended([&] { describe(text); }).error; };
  expect_all(broken(""), {"p.lua", "returns a table", "nothing"});
  expect_all(broken("\xEF\xBB\xBF\x1bLua"), {"p.lua", "not a text file"});
  expect_all(broken("--" + std::string(17'000'000, 'x')), {"p.lua", "larger than a script may be"});
  expect_all(broken("goto nowhere"), {"p.lua:1:", "no visible label 'nowhere'"});
  expect_all(
      run_file("local _ENV = {}\nreturn { title = 't', run = function() print('x') end }").error,
      {"p.lua:2:", "print"});
  EXPECT_EQ(run("for i = 1, 3 do if i == 2 then goto continue end print(i) ::continue:: end").error,
            "");
}

TEST_F(BadInput, AYieldWithoutAWaitIsAnError) {
  expect_all(run("coroutine.yield()").error, {"p.lua:2:"});
  expect_all(run("while true do coroutine.yield(1) end").error, {"p.lua:2:"});
  EXPECT_EQ(run("local co = coroutine.wrap(function() while true do coroutine.yield(1) end end) "
                "assert(co() == 1)")
                .error,
            "");
}

TEST_F(BadInput, AnErrorWhileSomethingIsClosedIsToldAndTheRestIsClosedToo) {
  const Ended end =
      run("run:defer(function() print('deferred') end)\n"
          "local a <close> = setmetatable({}, { __close = function() print('a') end })\n"
          "local b <close> = setmetatable({}, { __close = function() error('in close') end "
          "})\nerror({})");
  expect_all(end.error, {"in close"});
  EXPECT_EQ(said(0), "a");
  EXPECT_EQ(said(1), "deferred");
}

TEST_F(BadInput,
       AModuleThatIsALinkOutOfItsFolderIsRefusedAndOneThatSpoilsStringSpoilsItsOwnRunOnly) {
  write("outside.lua", "return 1");
  std::filesystem::create_symlink(folder.path() / "outside.lua",
                                  folder.path() / "lib" / "link.lua");
  write("lib/spoils.lua", "string.format = nil return 1");
  expect_all(run("require 'link'").error, {"p.lua:2:", "'link' is a link that leads out of"});
  expect_all(run("require 'spoils' print(('%d'):format(1))").error, {"p.lua:2:"});
  EXPECT_EQ(run("print(('%d'):format(1))").error, "");
}

TEST_F(BadInput, AWrongArgumentOfStringFormatIsToldWithTheScriptsLine) {
  expect_all(run("print(('%d'):format('x'))").error,
             {"p.lua:2: bad argument #2 to 'format'", "number expected, got string"});
  expect_all(run("print(string.format('%d %d', 1))").error,
             {"p.lua:2: bad argument #3 to 'format'"});
  expect_all(run("print(('%y'):format(1))").error, {"p.lua:2: invalid conversion '%y'"});
  expect_all(
      run("local named = setmetatable({}, { __tostring = function() error('in name') end })\n"
          "print(('%s'):format(named))")
          .error,
      {"in name"});
}

TEST_F(BadInput, WhatGrowsWithoutEndIsBounded) {
  expect_all(run("local function f() return f() + 1 end f()").error, {"stack overflow"});
  expect_all(
      run("local t = {} for i = 1, 30 do t[i] = ('x'):rep(10000000) end table.concat(t)").error,
      {"not enough memory"});
  expect_all(run("local t = setmetatable({}, {}) getmetatable(t).__index = t return t.x").error,
             {"p.lua:2:"});
}

// Every wait that took too long says which device, what it did, what it wanted, what was last read,
// how long it took, and where in the script.

TEST_F(BadInput, ACameraThatIsSilentIsNamedWithTheFrameThatWasLast) {
  camera.silent = true;
  expect_all(run("rig.top_camera:grab { timeout = 2 }").error,
             {"top_camera", "no frame came", "wanted a frame", "last reading no frame yet",
              "after 2 s", "p.lua:2"});
}

TEST_F(BadInput, ADeviceThatHangsIsNamedWithWhatItWasToDo) {
  expect_all(run("rig.lens_mover:move_to(3e-3, { timeout = 0.5 })").error,
             {"p.lua:2: lens_mover:move_to: lens_mover did not answer", "wanted 3 mm", "it hangs",
              "after 1 s"});
  camera.silent = true;
  expect_all(run("rig:learn_background { frames = 3, timeout = 0.1 }").error,
             {"p.lua:2: rig:learn_background: ", "3 frames", "after 100 ms"});
}

/// Sets off and never arrives.
class EndlessStage : public Stage {
 public:
  explicit EndlessStage(Clock& clock) : clock_(clock) { info_.axes = {{"x", -1, 1, 1, 0.1, 1e-6}}; }
  const StageInfo& info() const override { return info_; }
  std::vector<double> position() override { return {2e-3}; }
  void start(std::span<const double>, double) override {}
  bool moving() override { return true; }
  void wait(Time timeout) override {
    clock_.sleep_for(timeout);
    throw DeviceError(DeviceErrorKind::timeout, "stage", "it still moves");
  }
  void home(Time timeout) override { wait(timeout); }
  void stop() override {}
  void make_safe() override {}

 private:
  Clock& clock_;
  StageInfo info_;
};

class EndlessTurn : public RotationStage {
 public:
  explicit EndlessTurn(Clock& clock) : clock_(clock) {
    info_.axis = {"turn", -10, 10, 1, 0.1, 1e-6};
  }
  const RotationStageInfo& info() const override { return info_; }
  double position() override { throw DeviceError(DeviceErrorKind::lost, "rotation_stage", "gone"); }
  void start(double, double) override {}
  bool moving() override { return true; }
  void wait(Time timeout) override {
    clock_.sleep_for(timeout);
    throw DeviceError(DeviceErrorKind::timeout, "rotation_stage", "it still turns");
  }
  void home(Time timeout) override { wait(timeout); }
  void stop() override {}
  void make_safe() override {}

 private:
  Clock& clock_;
  RotationStageInfo info_;
};

class AbsentHands : public SampleHandler {
 public:
  explicit AbsentHands(Clock& clock) : clock_(clock) {}
  std::string identity() const override { return "nobody"; }
  void insert_robot(const Eigen::Vector3d&) override { remove_robot(); }
  void remove_robot() override { clock_.sleep_for(from_seconds(1e5)); }
  void place_target(const Eigen::Vector3d&) override { remove_robot(); }
  void remove_target() override { remove_robot(); }
  void change_vial(const std::string&, const std::string&) override { remove_robot(); }

 private:
  Clock& clock_;
};

TEST_F(BadInput, AStageThatNeverArrivesIsNamedWithItsTargetAndItsPlace) {
  EndlessStage stage(*clock);
  EndlessTurn turn(*clock);
  rig.stage = &stage;
  rig.rotation_stage = &turn;
  expect_all(
      run("rig.stage:move_to({ 5e-3 }, { timeout = 3 })").error,
      {"stage", "it still moves", "wanted 5 mm", "last reading 2 mm", "after 3 s", "p.lua:2"});
  expect_all(run("local motion = rig.stage:start({ 5e-3 })\nmotion:wait()").error,
             {"it still moves", "wanted 5 mm", "last reading 2 mm", "after 1 min 00 s", "p.lua:3"});
  expect_all(run("rig.stage:home()").error,
             {"wanted its reference", "after 2 min 00 s", "p.lua:2"});
  expect_all(run("rig.rotation_stage:move_to(1)").error,
             {"rotation_stage", "it still turns", "last reading none (rotation_stage: gone",
              "after 1 min 00 s", "p.lua:2"});
}

TEST_F(BadInput, HandsThatNeverComeAreNotWaitedForForEver) {
  AbsentHands hands(*clock);
  rig.sample = &hands;
  expect_all(run("rig.sample:insert_robot({ 0, 0, 0 })").error,
             {"p.lua:2: sample:insert_robot: sample did not answer", "after 10 min 00 s"});
}

TEST_F(BadInput, AQuestionThatNobodyAnswersEndsInAnError) {
  expect_all(run("run:confirm('Is it in?', { timeout = 0.05 })").error,
             {"p.lua:2: run:confirm: waited for an answer to 'Is it in?' for 50 ms in vain"});
}

TEST_F(BadInput, DeadTimeOfALoopIsWhatOnlyGotThingsReady) {
  EXPECT_EQ(run("for place in run:each({ 1e-3, 2e-3 }, 'places') do rig.lens_mover:move_to(place) "
                "run:wait(6) end")
                .error,
            "");
  ASSERT_FALSE(recorder.events().empty());
  EXPECT_EQ(recorder.events().back().kind, "loop");
  EXPECT_EQ(recorder.events().back().text,
            "places: 2 turns in 16 s, dead time 4 s (25.0 %): lens_mover:move_to 25.0 %");
  EXPECT_EQ(recorder.results().back().name, "dead_time");
  EXPECT_EQ(recorder.results().back().value, 4);
}

TEST_F(BadInput, AlarmsOfAScriptAreLatchedShownRecordedAndAcknowledged) {
  EXPECT_EQ(
      run("local alarm = run:alarm { name = 'coil', priority = 'high', text = 'too hot' }\n"
          "assert(run:alarms()[1].active)\nalarm:clear() alarm:clear()\n"
          "assert(#run:alarms() == 1)\nassert(run:acknowledge('coil') == 1 and #run:alarms() == 0)")
          .error,
      "");
  EXPECT_EQ(said(), "ALARM high: coil: too hot");
  ASSERT_EQ(recorder.events().size(), 3u);
  EXPECT_EQ(recorder.events()[0].text, "high: coil: too hot");
  EXPECT_EQ(recorder.events()[2].kind, "alarm acknowledged");
  expect_all(run("run:alarm { name = 'coil', priority = 'urgent', text = 'x' }").error,
             {"priority: wants low, medium or high, got 'urgent'"});
  expect_all(run("run:acknowledge('nothing')").error, {"no alarm 'nothing' stands"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
