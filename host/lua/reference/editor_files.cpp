// SPDX-License-Identifier: Apache-2.0
#include "host/lua/reference/editor_files.h"

#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/reference/reference.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

namespace vitreo::lua {
namespace {

constexpr const char* kHead =
    "-- Printed by the program from its own tables (vitreo docs stubs): not to be edited.\n";

std::string stub_type(const Argument& argument);

std::string table_type(const Argument& argument) {
  std::string text;
  for (const Argument& option : argument.options)
    text += (text.empty() ? "{ " : ", ") + option.name + (option.optional ? "?" : "") + ": " +
            stub_type(option);
  return text.empty() ? "table" : text + " }";
}

std::string choice_type(const Argument& argument) {
  std::string text;
  for (const std::string& choice : argument.choices)
    text += (text.empty() ? "\"" : "|\"") + choice + "\"";
  if (argument.other) text += "|string";
  return text.empty() ? "string" : text;
}

std::string stub_type(const Argument& argument) {
  switch (argument.type) {
    case Type::number:
      return "number";
    case Type::integer:
      return "integer";
    case Type::flag:
      return "boolean";
    case Type::text:
      return choice_type(argument);
    case Type::function:
      return "function";
    case Type::vector:
    case Type::direction:
      return "vitreo.vector|number[]";
    case Type::numbers:
      return "number[]";
    case Type::list:
      return "any[]";
    case Type::table:
      return "table";
    case Type::handle:
      return "vitreo." + argument.handle +
             (argument.choices.empty() ? "" : "|" + choice_type(argument));
    case Type::options:
      return table_type(argument);
    case Type::any:
      break;
  }
  return "any";
}

bool is_vector(const std::string& type) {
  const std::string_view kinds[] = {"position", "velocity",  "force",
                                    "field",    "direction", "vector"};
  return std::find(std::begin(kinds), std::end(kinds), type) != std::end(kinds);
}

/// A row's word for what it returns as a type of the language server; "any" for what it says in
/// other words.
std::string plain_type(const Library& library, const std::string& type) {
  if (find_class(library, type) != nullptr) return "vitreo." + type;
  if (type == "number" || type == "string") return type;
  if (is_vector(type)) return "vitreo.vector";
  if (type == "true or false") return "boolean";
  if (type == "path") return "string";
  if (type == "list of numbers") return "number[]";
  if (type == "list of names") return "string[]";
  if (type.starts_with("list of positions")) return "vitreo.vector[]";
  if (type.starts_with("list")) return "table[]";
  return type.starts_with("table") ? "table" : "any";
}

std::string return_type(const Library& library, const Returned& returns) {
  if (returns.type.empty()) return "";
  return plain_type(library, returns.type) + (returns.optional ? "?" : "");
}

/// Options of which none is needed may be left out as a whole, though their row does not say so.
bool may_be_left_out(const Argument& argument) {
  return argument.optional || (argument.type == Type::options &&
                               std::all_of(argument.options.begin(), argument.options.end(),
                                           [](const Argument& option) { return option.optional; }));
}

std::string with_unit(const Argument& argument) {
  std::string text = argument.unit.empty() ? "" : "in " + argument.unit;
  if (!argument.help.empty()) text += (text.empty() ? "" : "; ") + argument.help;
  return text.empty() ? "" : " # " + text;
}

std::string parameter_names(const Binding& row) {
  std::string text;
  for (const Argument& argument : row.arguments) text += (text.empty() ? "" : ", ") + argument.name;
  return text;
}

std::string returned_fields(const std::vector<ResultField>& fields, const std::string& indent) {
  std::string text;
  for (const ResultField& field : fields)
    text += indent + "`." + field.name + "`" + (field.unit.empty() ? "" : " in " + field.unit) +
            (field.optional ? ", or nil" : "") + (field.help.empty() ? "" : ": " + field.help) +
            "\n" + returned_fields(field.fields, indent + "  ");
  return text;
}

/// An annotated function without a body. The server has no units: they stand behind the # of each
/// parameter, and the fields of a result in the lines below @return.
std::string stub_of(const Library& library, const std::string& owner, char separator,
                    const std::string& name, const Entry& entry) {
  std::string text =
      "---" + entry.row->doc + "\n---\n---```lua\n---" + example(entry) + "\n---```\n";
  for (const Argument& argument : entry.row->arguments) {
    if (argument.type == Type::options)
      for (const Argument& option : options_by_name(argument))
        if (const std::string about = with_unit(option); !about.empty())
          text += "---- `" + option.name + "`:" + about.substr(2) + "\n";
    if (argument.name == "...")
      text += "---@param ... function\n";
    else
      text += "---@param " + argument.name + (may_be_left_out(argument) ? "? " : " ") +
              stub_type(argument) + with_unit(argument) + "\n";
  }
  if (const std::string type = return_type(library, entry.row->returns); !type.empty())
    text += "---@return " + type + " # " + entry.row->returns.text() + "\n" +
            returned_fields(entry.row->returns.fields, "---- ");
  return text + "function " + owner + separator + name + "(" + parameter_names(*entry.row) +
         ") end\n\n";
}

/// A method is declared with a colon, so that the server counts arguments as scripts write them.
std::string class_stub(const Library& library, const Class& kind) {
  std::string text = "---" + kind.doc + "\n---@class vitreo." + kind.name + "\n";
  for (const std::string& field : kind.fields) {
    const std::string type = field.ends_with("_camera") ? "camera" : field;
    text += "---@field " + field + " vitreo." +
            (find_class(library, type) != nullptr ? type : "any") + "\n";
  }
  text += "local " + kind.name + " = {}\n\n";
  for (const Binding& row : kind.methods)
    text += stub_of(library, kind.name, ':', row.name, {&kind, &row});
  return text;
}

constexpr const char* kVectorStub =
    R"(---A vector: a table {x, y, z} with arithmetic: a position in m, a force in N,
---a direction ....
---@class vitreo.vector
---@field x number
---@field y number
---@field z number
---@operator add(vitreo.vector): vitreo.vector
---@operator sub(vitreo.vector): vitreo.vector
---@operator mul(number): vitreo.vector
---@operator div(number): vitreo.vector
---@operator unm: vitreo.vector
local vector_class = {}

---@return number # its length
function vector_class:norm() end

---@param other vitreo.vector
---@return number
function vector_class:dot(other) end

---A vector with arithmetic.
---@param x number|number[]
---@param y? number
---@param z? number
---@return vitreo.vector
function vector(x, y, z) end

)";

std::string units_stub() {
  std::string text = std::string("---@meta units\n") + kHead + "\n---@class vitreo.units\n";
  for (const Unit& unit : units())
    if (const std::string name = unit_name(unit.symbol); !name.empty())
      text += fmt::format("---@field {} number # {}: 1 {} is {:g} {}\n", name, unit.quantity,
                          unit.symbol, unit.factor, unit.dimension);
  return text + "local units = {}\nreturn units\n";
}

std::string vitreo_stub(const Library& library) {
  std::string text = std::string("---@meta vitreo\n") + kHead + "\n" + kVectorStub;
  for (const Class* kind : library.classes) text += class_stub(library, *kind);
  for (const std::string& name : module_names(library)) text += name + " = {}\n";
  text += "\n";
  for (const Binding* row : all_functions(library)) {
    const std::size_t dot = row->name.rfind('.');
    if (dot == std::string::npos)
      text += stub_of(library, "", ' ', row->name, {nullptr, row});
    else
      text += stub_of(library, row->name.substr(0, dot), '.', row->name.substr(dot + 1),
                      {nullptr, row});
  }
  text += "return {";  // for those who compare: the classes by name
  for (const Class* kind : library.classes) text += " " + kind->name + " = " + kind->name + ",";
  return text + " }\n";
}

/// What luacheck calls fields: the keys of a table, down to those of modules in modules.
void write_fields(lua_State* L, int table, const std::string& indent, std::string& text) {
  std::set<std::string> names;
  for (lua_pushnil(L); lua_next(L, table) != 0; lua_pop(L, 1))
    if (lua_type(L, -2) == LUA_TSTRING) names.insert(lua_tostring(L, -2));
  for (const std::string& name : names) {
    if (name == "_G") continue;
    lua_pushstring(L, name.c_str());
    lua_rawget(L, table);
    if (lua_istable(L, -1)) {
      text += indent + name + " = { fields = {\n";
      write_fields(L, lua_gettop(L), indent + "  ", text);
      text += indent + "} },\n";
    } else {
      text += indent + name + " = {},\n";
    }
    lua_pop(L, 1);
  }
}

}  // namespace

// A module is a global of vitreo.lua; the file of its name only returns that, for require.
std::map<std::string, std::string> lua_stubs(const Library& library) {
  std::map<std::string, std::string> files{{"vitreo.lua", vitreo_stub(library)},
                                           {"units.lua", units_stub()}};
  for (const std::string& name : module_names(library))
    if (name.find('.') == std::string::npos)
      files[name + ".lua"] = "---@meta " + name + "\n" + kHead + "return " + name + "\n";
  return files;
}

// Read from a live state, not from the rows: Lua's own names are among them, less those that the
// sandbox takes away.
std::string luacheck_standard(const Library& library) {
  std::string text =
      "-- For luacheck, printed by the program from what its scripts can see (vitreo docs "
      "luacheck).\n"
      "max_line_length = 130\nunused_args = false  -- every protocol takes rig, p and run\nstd = "
      "\"vitreo\"\nstds.vitreo = { read_globals = {\n";
  const State state(library, nullptr, {});
  lua_State* const L = state.main();
  in_lua(L, 0, [&] {
    lua_pushglobaltable(L);
    write_fields(L, 1, "  ", text);
    lua_settop(L, 0);
  });
  return text + "  settings = {}, -- of an instrument's file\n} }\n";
}

}  // namespace vitreo::lua
