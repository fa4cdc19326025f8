// A stop cannot be swallowed, and the script's own clean-up still runs.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

#include <atomic>
#include <chrono>
#include <csignal>
#include <sys/time.h>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

std::atomic<ScriptEngine*> the_engine{nullptr};
std::atomic<Clock*> the_clock{nullptr};

void on_alarm(int) {
  if (ScriptEngine* const engine = the_engine) engine->interrupt();
  if (Clock* const clock = the_clock) clock->interrupt();
}

class Stopping : public LuaBench {
 protected:
  Stopping() { std::signal(SIGALRM, on_alarm); }
  ~Stopping() override {
    arm(0);
    std::signal(SIGALRM, SIG_DFL);
    the_engine = nullptr;
    the_clock = nullptr;
  }

  /// As a key press after `milliseconds` of wall time would do, in the middle of Lua's own work.
  void press_in(int milliseconds, bool clock_too = true, bool again = false) {
    the_engine = engine.get();
    the_clock = clock_too ? clock.get() : nullptr;
    arm(milliseconds, again);
  }

  /// At virtual time `seconds`.
  std::unique_ptr<Task> press_at(double seconds) {
    return clock->spawn("finger", [this, seconds] {
      clock->sleep_until(from_seconds(seconds));
      clock->interrupt();
    });
  }

 private:
  static void arm(int milliseconds, bool again = false) {
    itimerval timer{};
    timer.it_value.tv_usec = milliseconds * 1000;
    if (again) timer.it_interval = timer.it_value;
    setitimer(ITIMER_REAL, &timer, nullptr);
  }
};

TEST_F(Stopping, AStopEndsAWait) {
  const auto finger = press_at(2);
  EXPECT_TRUE(run("run:wait(10) print('not reached')").stopped);
  EXPECT_EQ(said(), "(nothing)");
  EXPECT_EQ(to_seconds(clock->now()), 2);
}

TEST_F(Stopping, PcallXpcallCoroutinesAndBadCleanUpCannotSwallowIt) {
  for (const char* body : {
           "while true do pcall(function() run:wait(1) end) end",
           "while true do pcall(pcall, run.wait, run, 1) end",
           "while true do xpcall(function() run:wait(1) end, function(e) return 'mine' end) end",
           "while true do coroutine.resume(coroutine.create(function() run:wait(1) end)) end",
           "while true do pcall(coroutine.wrap(function() run:wait(1) end)) end",
           "while true do pcall(function() local x <close> = setmetatable({}, {__close = "
           "function() error('mine') "
           "end}) run:wait(1) end) end",
           "while true do pcall(run.together, run, function() run:wait(1) end, function() "
           "run:wait(2) end) end",
           "while true do pcall(rig.top_camera.grab, rig.top_camera) end",
       }) {
    const auto finger = press_at(to_seconds(clock->now()) + 3.5);
    EXPECT_TRUE(run(body).stopped) << body;
  }
}

TEST_F(Stopping, CleanUpRunsWithTheFullApiOnAStop) {
  const auto finger = press_at(2);
  EXPECT_TRUE(run("run:defer(function() print('deferred first') end)\n"
                  "run:defer(function() run:wait(1) print('deferred last ' .. run:now()) end)\n"
                  "local x <close> = setmetatable({}, {__close = function() run:wait(1)\n"
                  "  print(pcall(error, 'caught', 0)) rig.top_camera:grab() print('closed ' .. "
                  "math.floor(run:now())) end})\n"
                  "run:wait(10)")
                  .stopped);
  EXPECT_EQ(listener.lines, (std::vector<std::string>{"false\tcaught", "closed 3",
                                                      "deferred last 4.1", "deferred first"}));
}

TEST_F(Stopping, CleanUpInsideACoroutineCanWait) {
  const auto finger = press_at(2);
  EXPECT_TRUE(run("coroutine.wrap(function()\n local x <close> = setmetatable({}, {__close = "
                  "function() run:wait(1) "
                  "print('closed') end})\n"
                  " run:wait(10) end)()")
                  .stopped);
  EXPECT_EQ(said(), "closed");
}

TEST_F(Stopping, AnEndlessLoopIsStoppedBySignal) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; this loop has none";
#endif
  for (const char* body :
       {"while true do end", "while true do pcall(function() while true do end end) end",
        "coroutine.wrap(function() while true do end end)()",
        "while true do coroutine.wrap(function() coroutine.yield() end)() end",
        "xpcall(function() while true do end end, function() while true do end end)",
        "table.sort({1, 2, 3}, function() while true do end end)",
        "local t = setmetatable({}, {__index = function() while true do end end}) return t.x",
        "while true do run:now() end"}) {
    press_in(30, true, true);  // on a busy machine the first comes before there is a loop
    EXPECT_TRUE(run(body).stopped) << body;
    press_in(0);
  }
}

/// A function that closes a variable whose __close does `what`.
std::string closing(const std::string& what) {
  return "(function() local y <close> = setmetatable({}, {__close = function() " + what +
         " end}) while true do end end)";
}

TEST_F(Stopping, ACloseThatYieldsInACoroutineDoesNotSwallowIt) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; this loop has none";
#endif
  const std::string yields = closing("coroutine.yield()");
  const std::string waits_and_yields = closing("run:wait(0.01) coroutine.yield()");
  for (const std::string& body : {
           "coroutine.wrap(" + yields + ")()",
           "coroutine.resume(coroutine.create(" + yields + "))",
           "while true do coroutine.wrap(" + yields + ")() end",
           "coroutine.wrap(" + waits_and_yields + ")()",
           "coroutine.resume(coroutine.create(" + waits_and_yields + "))",
           "run:together(function() coroutine.wrap(" + yields + ")() end, function() end)",
           std::string("local co = coroutine.create(function() local y <close> = setmetatable({}, "
                       "{__close = function() while true do end end}) coroutine.yield() end) "
                       "coroutine.resume(co) coroutine.close(co)"),
           "local co = coroutine.create(function() local y <close> = setmetatable({}, {__close = "
           "function() " +
               yields + "() end}) coroutine.yield() end) coroutine.resume(co) coroutine.close(co)",
       }) {
    press_in(30, true, true);
    EXPECT_TRUE(run(body + " print('END OF SCRIPT')").stopped) << body;
    press_in(0);
    EXPECT_EQ(said(), "(nothing)") << body;
  }
}

// Each ran for seconds, minutes or years before it felt a stop.
TEST_F(Stopping, FunctionsOfTheLibraryThatTakeLongFeelIt) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; these have none";
#endif
  for (const char* body : {
           "while true do pcall(string.rep, '', math.maxinteger // 2) end",
           "while true do pcall(string.rep, 'x', 1e8 // 1 | 0) end",
           "while true do pcall(table.move, {}, 1, math.maxinteger - 1, 2) end",
           "string.find(('a'):rep(100000), ('a*'):rep(40) .. 'b')",
           "string.match(('a'):rep(100000), '.-.-.-.-.-b$')",
           "for x in string.gmatch(('a'):rep(100000), '.-.-.-.-.-b$') do end",
           "string.gsub(('a'):rep(100000), '.-.-.-.-.-b$', '')",
           "while true do pcall(string.find, ('a'):rep(100000), '.-.-.-.-.-b$') end",
           "local t = {} for i = 1, 2e6 do t[i] = i * 7919 % 1000003 end while true do "
           "table.sort(t) end",
           "local t = setmetatable({}, {__len = function() return 1 << 60 end}) while true do "
           "pcall(table.insert, t, 1, 1) end",
           "local t = setmetatable({}, {__len = function() return 1 << 60 end}) while true do "
           "pcall(table.remove, t, 1) end",
           "while true do pcall(load, ('x=1 '):rep(4000000)) end",
           "local s = ('x'):rep(16000000) while true do utf8.len(s) s:upper():reverse() end",
       }) {
    press_in(30, true, true);
    const Ended end = run(body);
    press_in(0);
    EXPECT_TRUE(end.stopped) << body << "\n" << end.error << end.trace;
  }
}

TEST_F(Stopping, TwentyThousandTasksSideBySideFeelIt) {
  const auto finger = press_at(1);
  EXPECT_TRUE(run("local tasks = {} for i = 1, 20000 do tasks[i] = function() run:wait(1000) end "
                  "end run:together(table.unpack(tasks))")
                  .stopped);
  EXPECT_EQ(to_seconds(clock->now()), 1);
}

TEST_F(Stopping, CleanUpAfterAnEndlessLoopRunsInFull) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; this loop has none";
#endif
  for (const bool clock_too : {true, false}) {
    listener.lines.clear();
    press_in(30, clock_too);
    EXPECT_TRUE(run("run:defer(function() run:wait(1) print('deferred') end)\n"
                    "local x <close> = setmetatable({}, {__close = function()\n for i = 1, 1e5 do "
                    "end run:wait(1) "
                    "print('closed') end})\n"
                    "while true do end")
                    .stopped);
    EXPECT_EQ(listener.lines, (std::vector<std::string>{"closed", "deferred"}));
  }
}

TEST_F(Stopping, FromAnotherThreadItTakesEffectAtTheNextHostCall) {
  std::atomic<bool> ended{false};
  std::thread other([&] {
    while (!ended) {  // before the script runs there is nothing to stop
      std::this_thread::sleep_for(std::chrono::milliseconds(30));
      engine->interrupt();
    }
  });
  EXPECT_TRUE(run("while true do pcall(function() run:now() end) end").stopped);
  ended = true;
  other.join();
}

TEST_F(Stopping, ARunAfterAStoppedOneIsNotStopped) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; this loop has none";
#endif
  press_in(20);
  EXPECT_TRUE(run("while true do end").stopped);
  EXPECT_EQ(run("for i = 1, 1e5 do end run:wait(1)").error, "");
  engine->interrupt();  // nothing runs: nothing to stop
  EXPECT_EQ(run("run:wait(1)").error, "");
}

TEST_F(Stopping, ErrorsOfCleanUpDoNotHideTheFirst) {
  expect_all(run("run:defer(function() error('second') end) error('first')").error, {"first"});
  expect_all(run("run:defer(function() error('only') end)").error, {"p.lua:2: only"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
