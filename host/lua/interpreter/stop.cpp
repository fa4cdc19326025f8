// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/stop.h"

#include "devices/time/error.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/turn.h"

#include <algorithm>
#include <cstdint>
#include <ctime>

namespace vitreo::lua {
namespace {

// Of all waits of a clean-up together. An abort has less: the devices are safe already.
constexpr Time kCleanUp = std::chrono::seconds(5), kShortCleanUp = std::chrono::seconds(1);
const char kStop = 0;  // its address is the stop object: no script can make or compare one

/// Armed on demand (arm_stop), as a hook that is always there would slow down each loop.
/// raise_stop() disarms it, so that the clean-up can run.
void stop_hook(lua_State* L, lua_Debug*) {
  Context& context = context_of(L);
  if (!context.interrupted) {  // inherited from the coroutine that made this one
    lua_sethook(L, nullptr, 0, 0);
    return;
  }
  take_interrupt(context);
  raise_stop(L);
}

// Of a file that is only being read. The count ends a loop without an end; the time ends one whose
// instructions are few and long, such as those that copy a text of megabytes.
constexpr int kReadingStep = 100;  // instructions between two looks
constexpr std::int64_t kMostInstructions =
    20'000'000;                     // a few tenths of a second; files need thousands
constexpr double kMostReading = 2;  // s of the thread's own time

/// s: what other threads and programs do does not count.
double thread_seconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// For files that are read without a run, such as a rig's: an endless loop in one ends here. The
/// budget is the state's: a coroutine inherits the hook, and has none of its own.
void limit_hook(lua_State* L, lua_Debug*) {
  Context& context = context_of(L);
  context.reading_left -= kReadingStep;
  if (context.reading_left > 0 && thread_seconds() < context.reading_ends) return;
  if (context.session == nullptr && context.stopped_at.empty()) context.stopped_at = where(L);
  push_stop(L);
  lua_error(L);
}

}  // namespace

void feel_stop(lua_State* L) {
  Context& context = context_of(L);
  if (context.session == nullptr) {
    if (context.reading_ends > 0) limit_hook(L, nullptr);
    return;
  }
  if (!context.interrupted) return;
  take_interrupt(context);
  raise_stop(L);
}

void push_stop(lua_State* L) { lua_pushlightuserdata(L, const_cast<char*>(&kStop)); }
bool is_stop(lua_State* L, int index) {
  return lua_touserdata(L, index) == static_cast<const void*>(&kStop);
}

void raise_stop(lua_State* L) {
  Context& context = context_of(L);
  lua_sethook(L, nullptr, 0, 0);
  context.interrupted = false;
  if (context.stopped_at.empty()) context.stopped_at = where(L);
  if (context.stops_felt) ++*context.stops_felt;
  push_stop(L);
  lua_error(L);
  throw Stopped();  // not reached: lua_error does not return
}

std::size_t stops_felt(lua_State* L) {
  const std::size_t* const felt = context_of(L).stops_felt;
  return felt == nullptr ? 0 : *felt;
}

void let_stop_pass(lua_State* L, std::size_t before) {
  if (stops_felt(L) == before) return;
  push_stop(L);
  lua_error(L);
}

void take_interrupt(Context& context) {
  if (!context.interrupted.exchange(false) || !context.session) return;
  const HostCode host(context);
  Session& session = *context.session;
  try {  // where a watchdog has taken the baton, this stands still until it is given back
    session.clock.sleep_until(session.clock.now());
  } catch (const Stopped&) {
  }
  session.control.begin_stopping();
  limit_clean_up(context);
}

void limit_clean_up(Context& context) {
  const StopTier tier = context.session->control.tier();
  const Time budget = tier == StopTier::emergency ? Time(0)
                      : tier == StopTier::abort   ? kShortCleanUp
                                                  : kCleanUp;
  context.waits_end = std::min(context.waits_end, later(context.session->clock.now(), budget));
}

/// Also from a signal handler on Lua's own thread, as lua.c does it. At calls, returns and each
/// instruction: the stop is felt at once, in a tight loop too.
void arm_stop(lua_State* L) noexcept {
  lua_sethook(L, stop_hook, LUA_MASKCALL | LUA_MASKRET | LUA_MASKCOUNT, 1);
}

void arm_reading_limit(lua_State* L) {
  Context& context = context_of(L);
  context.reading_left = kMostInstructions;
  context.reading_ends = thread_seconds() + kMostReading;
  lua_sethook(L, limit_hook, LUA_MASKCOUNT, kReadingStep);
}

}  // namespace vitreo::lua
