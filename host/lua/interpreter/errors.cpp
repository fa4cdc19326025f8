// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/errors.h"

#include "devices/time/error.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/stop.h"
#include "host/lua/interpreter/values.h"
#include "host/session/script_engine.h"
#include "host/text/error_words.h"

#include <new>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr const char* kDeviceError = "device error";

int device_error_text(lua_State* L) {
  lua_getfield(L, 1, "where");
  lua_getfield(L, 1, "message");
  lua_concat(L, 2);
  return 1;
}

void push_device_error(lua_State* L, const DeviceError& error, const std::string& place) {
  lua_createtable(L, 0, 4);
  lua_pushstring(L, to_string(error.kind));
  lua_setfield(L, -2, "kind");
  lua_pushstring(L, error.device.c_str());
  lua_setfield(L, -2, "device");
  lua_pushstring(L, error.what());
  lua_setfield(L, -2, "message");
  lua_pushstring(L, place.c_str());
  lua_setfield(L, -2, "where");
  lua_pushinteger(L, static_cast<lua_Integer>(error.kind));
  lua_setfield(L, -2, "code");
  luaL_setmetatable(L, kDeviceError);
}

bool is_device_error(lua_State* L, int index) {
  if (!lua_istable(L, index) || !lua_getmetatable(L, index)) return false;
  luaL_getmetatable(L, kDeviceError);
  const bool same = lua_rawequal(L, -1, -2);
  lua_pop(L, 2);
  return same;
}

std::string field_text(lua_State* L, int index, const char* name) {
  lua_getfield(L, index, name);
  const char* text = lua_tostring(L, -1);
  std::string result = text ? text : "";
  lua_pop(L, 1);
  return result;
}

/// DeviceError adds "device: " and " (kind)" to what it is given; what() already holds them.
std::string bare_message(std::string message, const std::string& device, DeviceErrorKind kind) {
  const std::string head = device + ": ", tail = std::string(" (") + to_string(kind) + ")";
  if (message.starts_with(head)) message.erase(0, head.size());
  if (message.ends_with(tail)) message.erase(message.size() - tail.size());
  return message;
}

std::exception_ptr device_exception(lua_State* L, int index) {
  lua_getfield(L, index, "code");
  const auto kind = static_cast<DeviceErrorKind>(lua_tointeger(L, -1));
  lua_pop(L, 1);
  const std::string device = field_text(L, index, "device");
  std::string place = field_text(L, index, "where");
  if (place.size() > 2) place = " at " + place.substr(0, place.size() - 2);
  const std::string message = bare_message(field_text(L, index, "message"), device, kind);
  return std::make_exception_ptr(DeviceError(kind, device, message + place));
}

std::string memory_text(const Context& context) {
  return (context.where.empty() ? "" : context.where) + "not enough memory: a script may use " +
         std::to_string(context.memory_limit >> 20) + " MB";
}

struct Body {
  const std::function<void()>* run;
  std::exception_ptr error;
};

int run_body(lua_State* L) {
  auto& body = *static_cast<Body*>(lua_touserdata(L, lua_upvalueindex(1)));
  try {
    (*body.run)();
  } catch (const std::exception&) {
    body.error = std::current_exception();
    return 0;
  }
  return lua_gettop(L);
}

}  // namespace

int guarded(lua_State* L, const std::string& prefix, const std::function<int()>& body) {
  bool stopped = false;
  try {
    return body();
  } catch (const Stopped&) {
    stopped = true;
  } catch (const DeviceError& error) {
    push_device_error(L, error, where(L));
  } catch (const ScriptError& error) {  // says its place itself
    lua_pushstring(L, error.what());
  } catch (const std::bad_alloc&) {
    lua_pushstring(L, (where(L) + prefix + "not enough memory").c_str());
  } catch (const std::exception& error) {
    lua_pushstring(L, (where(L) + prefix + error_words(error)).c_str());
  }
  if (stopped) {
    take_interrupt(context_of(L));
    raise_stop(L);
  }
  return lua_error(L);
}

void in_lua(lua_State* L, int arguments, const std::function<void()>& run) {
  Body body{&run, nullptr};
  if (!lua_checkstack(L, 10)) throw std::bad_alloc();
  lua_pushlightuserdata(L, &body);
  lua_pushcclosure(
      L, run_body,
      1);  // no error from memory in practice: the state was just made or has just collected
  lua_insert(L, -1 - arguments);
  const int status = lua_pcall(L, arguments, LUA_MULTRET, 0);
  if (body.error) std::rethrow_exception(body.error);
  if (status != LUA_OK) std::rethrow_exception(to_exception(L, status));
}

int remember_trace(lua_State* L) {
  if (is_stop(L, 1)) return 1;
  Context& context = context_of(L);
  context.where = where(L);
  luaL_traceback(L, L, nullptr, 1);
  context.trace = lua_tostring(L, -1);
  lua_pop(L, 1);
  return 1;
}

std::string error_text(lua_State* L, int index) {
  if (is_stop(L, index)) return "stopped";
  return plain_text(L, index);
}

namespace {

/// What a script threw, which need not be a text: its own words where it has some, else what is in
/// it.
std::string thrown_text(lua_State* L, int index) {
  if (lua_isnil(L, index)) return "an error without a message (nil)";
  const bool table = lua_istable(L, index),
             speaks = luaL_getmetafield(L, index, "__tostring") != LUA_TNIL;
  if (speaks) lua_pop(L, 1);
  if (table && !speaks) {
    const std::string said = field_text(L, index, "message");
    return said.empty() ? "an error that is a table: " + pretty(L, index, 2) : said;
  }
  const std::string shown = plain_text(L, index);
  return shown == lua_typename(L, lua_type(L, index)) ? "an error that is a " + shown : shown;
}

std::exception_ptr exception_of(lua_State* L, int status) {
  Context& context = context_of(L);
  // A coroutine's memory error comes out of its body as a plain one.
  const bool no_memory =
      status == LUA_ERRMEM || (context.short_of_memory && lua_type(L, -1) == LUA_TSTRING &&
                               std::string(lua_tostring(L, -1)) == "not enough memory");
  if (no_memory) return std::make_exception_ptr(ScriptError(memory_text(context), context.trace));
  if (is_device_error(L, -1)) return device_exception(L, lua_gettop(L));
  const bool has_place = lua_type(L, -1) == LUA_TSTRING;
  return std::make_exception_ptr(
      ScriptError((has_place ? "" : context.where) + thrown_text(L, lua_gettop(L)), context.trace));
}

struct Conversion {
  int status;
  std::exception_ptr made;
};

int convert(lua_State* L) {
  auto& conversion = *static_cast<Conversion*>(lua_touserdata(L, 1));
  lua_remove(L, 1);
  try {
    conversion.made = exception_of(L, conversion.status);
  } catch (const std::exception&) {  // a table that has no order
  }
  return 0;
}

/// An error's __tostring is the script's own code: it can be stopped like all of it, and ends by
/// itself even so.
class BoundedReading {
 public:
  explicit BoundedReading(lua_State* L)
      : state_(L), hook_(lua_gethook(L)), mask_(lua_gethookmask(L)), count_(lua_gethookcount(L)) {
    outer_ = context_of(L).running.exchange(L);
    arm_reading_limit(L);
    if (context_of(L).interrupted) arm_stop(L);
  }
  ~BoundedReading() {
    context_of(state_).running = outer_;
    lua_sethook(state_, hook_, mask_, count_);
  }
  BoundedReading(const BoundedReading&) = delete;
  BoundedReading& operator=(const BoundedReading&) = delete;

 private:
  lua_State* const state_;
  lua_State* outer_;
  const lua_Hook hook_;
  const int mask_, count_;
};

}  // namespace

std::exception_ptr to_exception(lua_State* L, int status) {
  if (is_stop(L, -1)) {  // nothing of a script's is run for it, which a second one could end
    lua_pop(L, 1);
    return std::make_exception_ptr(Stopped());
  }
  const BoundedReading bounded(L);
  Conversion conversion{status, nullptr};
  lua_checkstack(L, 4);
  lua_pushcfunction(L, convert);
  lua_insert(L, -2);
  lua_pushlightuserdata(L, &conversion);
  lua_insert(L, -2);
  const bool failed = lua_pcall(L, 2, 0, 0) != LUA_OK;
  const Session* const session = context_of(L).session;
  const bool stopped =
      failed && is_stop(L, -1) && session && session->control.tier() != StopTier::none;
  if (failed) lua_pop(L, 1);
  if (conversion.made) return conversion.made;
  if (stopped) return std::make_exception_ptr(Stopped());
  return std::make_exception_ptr(
      ScriptError(context_of(L).where + "an error that cannot be shown"));
}

void open_errors(lua_State* L) {
  luaL_newmetatable(L, kDeviceError);
  lua_pushcfunction(L, device_error_text);
  lua_setfield(L, -2, "__tostring");
  lua_pushstring(L, kDeviceError);
  lua_setfield(L, -2, "__name");
  lua_pushstring(L, kDeviceError);
  lua_setfield(L, -2, "__metatable");
  lua_pop(L, 1);
}

}  // namespace vitreo::lua
