// Vectors in Lua: plain tables {x, y, z} whose metatable gives them arithmetic, .x .y .z, :norm()
// and :dot().
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/values.h"

#include <fmt/format.h>

#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr const char* kVector = "vector";

/// Any list of three numbers is a vector, so scripts may write {x, y, z} wherever one is wanted.
Eigen::Vector3d vector_at(lua_State* L, int index) {
  if (const auto vector = to_vector(L, index)) return *vector;
  throw std::invalid_argument("wants a vector {x, y, z}, got " + kind_of(L, index));
}

/// Text that looks like a number is refused, as by check_arguments.
double number_at(lua_State* L, int index) {
  if (lua_type(L, index) != LUA_TNUMBER)
    throw std::invalid_argument("wants a number, got " + kind_of(L, index));
  return lua_tonumber(L, index);
}

int with_result(lua_State* L, const Eigen::Vector3d& vector) {
  push_vector(L, vector);
  return 1;
}

/// One C function for each operation, made from a plain one.
/// The guard turns a C++ exception into an error of Lua's with the position in the script.
template <int (*operation)(lua_State*)>
int checked(lua_State* L) {
  return guarded(L, "vector: ", [L] { return operation(L); });
}

int add(lua_State* L) { return with_result(L, vector_at(L, 1) + vector_at(L, 2)); }
int subtract(lua_State* L) { return with_result(L, vector_at(L, 1) - vector_at(L, 2)); }
int negate(lua_State* L) { return with_result(L, -vector_at(L, 1)); }
int divide(lua_State* L) { return with_result(L, vector_at(L, 1) / number_at(L, 2)); }
/// Two vectors have no product by *, as it would be ambiguous: there is dot.
int multiply(lua_State* L) {
  if (lua_type(L, 1) == LUA_TNUMBER) return with_result(L, lua_tonumber(L, 1) * vector_at(L, 2));
  return with_result(L, vector_at(L, 1) * number_at(L, 2));
}
/// Exact, as == of numbers; something that is no vector is equal to none.
int equal(lua_State* L) {
  const auto a = to_vector(L, 1), b = to_vector(L, 2);
  lua_pushboolean(L, a && b && *a == *b);
  return 1;
}
int norm(lua_State* L) {
  lua_pushnumber(L, vector_at(L, 1).norm());
  return 1;
}
int dot(lua_State* L) {
  lua_pushnumber(L, vector_at(L, 1).dot(vector_at(L, 2)));
  return 1;
}
/// Six digits, in SI: for people, not to be read back.
int text(lua_State* L) {
  const Eigen::Vector3d v = vector_at(L, 1);
  lua_pushstring(L, fmt::format("{{{:.6g}, {:.6g}, {:.6g}}}", v.x(), v.y(), v.z()).c_str());
  return 1;
}

/// 1 to 3 for x, y, z as the entries of the list, 0 for another name.
int coordinate(const char* name) {
  if (name[0] < 'x' || name[0] > 'z' || name[1] != '\0') return 0;
  return name[0] - 'x' + 1;
}

/// Called only for what the table itself has not, so never for its entries. Upvalue 1 has the
/// methods.
int read(lua_State* L) {
  if (lua_type(L, 2) != LUA_TSTRING) return 0;
  const char* name = lua_tostring(L, 2);
  if (const int at = coordinate(name)) {
    lua_rawgeti(L, 1, at);
    return 1;
  }
  lua_getfield(L, lua_upvalueindex(1), name);
  return 1;
}

/// Entries 1 to 3 are there from the start and are set without it; what comes here is a name, or a
/// fourth entry, which is refused.
int write(lua_State* L) {
  const int at = lua_type(L, 2) == LUA_TSTRING ? coordinate(lua_tostring(L, 2)) : 0;
  if (at == 0) throw std::invalid_argument("only x, y and z can be set");
  lua_pushnumber(L, number_at(L, 3));
  lua_rawseti(L, 1, at);
  return 0;
}

/// From three numbers or from a list of three.
int make(lua_State* L) {
  const Eigen::Vector3d v =
      lua_istable(L, 1) ? vector_at(L, 1)
                        : Eigen::Vector3d(number_at(L, 1), number_at(L, 2), number_at(L, 3));
  return with_result(L, v);
}

}  // namespace

void push_vector(lua_State* L, const Eigen::Vector3d& vector) {
  lua_createtable(L, 3, 0);
  for (int i = 0; i < 3; ++i) {
    lua_pushnumber(L, vector[i]);
    lua_rawseti(L, -2, i + 1);
  }
  luaL_setmetatable(L, kVector);
}

/// The field __metatable hides the metatable: a script cannot change the arithmetic of all vectors.
void open_vectors(lua_State* L) {
  luaL_newmetatable(L, kVector);
  const luaL_Reg operations[] = {
      {"__add", checked<add>},       {"__sub", checked<subtract>},   {"__unm", checked<negate>},
      {"__div", checked<divide>},    {"__mul", checked<multiply>},   {"__eq", checked<equal>},
      {"__tostring", checked<text>}, {"__newindex", checked<write>}, {nullptr, nullptr}};
  luaL_setfuncs(L, operations, 0);
  const luaL_Reg methods[] = {{"norm", checked<norm>}, {"dot", checked<dot>}, {nullptr, nullptr}};
  luaL_newlib(L, methods);
  lua_pushcclosure(L, checked<read>, 1);
  lua_setfield(L, -2, "__index");
  lua_pushstring(L, kVector);
  lua_setfield(L, -2, "__name");
  lua_pushstring(L, kVector);
  lua_setfield(L, -2, "__metatable");
  lua_pop(L, 1);
  lua_pushcfunction(L, checked<make>);
  lua_setglobal(L, "vector");
}

}  // namespace vitreo::lua
