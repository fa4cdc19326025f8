// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/declaration.h"

#include "devices/scripted/declaration_parts.h"
#include "devices/scripted/lua_values.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <set>
#include <utility>

namespace vitreo::scripted {
namespace {

/// Functions that a role's file has, and which of them it must have.
struct RoleShape {
  const char* kind;
  std::vector<const char*> must{};
  std::vector<const char*> may{};
};
/// The one list of kinds: what has functions that it must have is a role of the program's, the rest
/// are free (is_free()).
const std::vector<RoleShape>& shapes() {
  static const std::vector<RoleShape> all{
      {"stage", {"position", "set_off", "moving", "halt"}, {"home", "homed"}},
      {"rotation_stage", {"position", "set_off", "moving", "halt"}, {"home", "homed"}},
      {"lens_mover", {"position", "set_off", "moving", "halt", "home"}, {"homed"}},
      {"field_probe", {"measure"}, {}},
      {"current_sensor", {"measure"}, {}},
      {"coils", {"set_currents"}, {"measured_currents"}},
      {"lamp", {"set_level"}, {}},
      {"sensor", {}, {}},
      {"actuator", {}, {}},
      {"pump", {}, {}},
      {"switch", {}, {}},
      {"interlock_input", {}, {}},
      {"instrument", {}, {}},
  };
  return all;
}

const RoleShape& shape_of(const std::string& kind) {
  return *std::find_if(shapes().begin(), shapes().end(),
                       [&](const RoleShape& one) { return kind == one.kind; });
}

/// What `settings { ... }` of the file declares, and what it is given.
struct Asked {
  Sandbox* sandbox;
  const UnitLookup* units;
  const SettingValues* given;
  std::vector<SettingDeclaration> declared{};
  bool called = false;
};

/// rate = { 5, unit = "mL/min", min = 0, max = 20, help = "..." }, or rate = 5.
SettingDeclaration read_setting(TableReader& all, const std::string& name,
                                const UnitLookup& units) {
  check_name(all, name);
  SettingDeclaration setting{.name = name};
  std::optional<TableReader> reader;
  try {
    reader = all.table(name);
  } catch (const ScriptFault&) {  // its default alone
    setting.fallback = *all.value(name);
  }
  if (reader) {
    const auto fallback = reader->value("default");
    if (!fallback) reader->fail("default", "is missing: name = { default = 5, unit = \"mm\" }");
    setting.fallback = *fallback;
    setting.unit = read_unit(*reader, units);
    setting.min = reader->number("min", -kHuge, kHuge).value_or(setting.min);
    setting.max = reader->number("max", -kHuge, kHuge).value_or(setting.max);
    setting.choices = reader->texts("choices");
    setting.help = reader->text("help", "");
    reader->finish();
  }
  setting.type = std::holds_alternative<double>(setting.fallback) ? QuantityType::number
                 : std::holds_alternative<bool>(setting.fallback) ? QuantityType::flag
                                                                  : QuantityType::text;
  return setting;
}

/// settings { ... } of the file: [table] -> [the values that hold].
// What is wrong is an error of Lua's, so that it gets its line; nothing is thrown through Lua.
int declare_settings(lua_State* L) {
  Asked* const open = *static_cast<Asked**>(lua_touserdata(L, lua_upvalueindex(1)));
  if (open == nullptr)
    return luaL_error(L, "settings: is called while the file is read, not later");
  Asked& asked = *open;
  std::string problem;
  try {
    const Sandbox::HostWork work(*asked.sandbox);
    if (lua_type(L, 1) != LUA_TTABLE) throw ScriptFault("settings: must be given a table");
    if (std::exchange(asked.called, true)) throw ScriptFault("settings: is called a second time");
    lua_settop(L, 1);
    // The reader works on the main thread's stack; the file runs on a coroutine's.
    lua_xmove(L, asked.sandbox->stack(), 1);
    TableReader reader(*asked.sandbox, "settings");
    lua_newtable(L);
    for (const std::string& name : reader.keys()) {
      asked.declared.push_back(read_setting(reader, name, *asked.units));
      const auto given = asked.given->find(name);
      push_quantity(L,
                    given == asked.given->end() ? asked.declared.back().fallback : given->second);
      lua_setfield(L, -2, name.c_str());
    }
    return 1;
  } catch (const std::exception& error) {
    problem = error.what();
  }
  lua_settop(L, 0);
  lua_pushlstring(L, problem.data(), problem.size());
  return lua_error(L);
}

AxisDeclaration read_axis(TableReader& reader, const UnitLookup& units, const char* si) {
  AxisDeclaration axis;
  axis.name = reader.text("name", "x");
  check_name(reader, axis.name);
  axis.unit = read_unit(reader, units);
  if (axis.unit.si != si) reader.fail("unit", std::string("must be one of ") + si);
  const std::vector<double> travel = reader.numbers("travel");
  if (travel.size() != 2 || travel[0] >= travel[1]) reader.fail("travel", "must be { from, to }");
  axis.travel_min = axis.unit.to_si(travel[0]);
  axis.travel_max = axis.unit.to_si(travel[1]);
  // Speeds and resolutions are lengths, or angles, of the axis' unit: per second for speeds.
  const auto positive = [&](const char* key) {
    const auto number = reader.number(key, 1e-12, kHuge);
    if (!number) reader.fail(key, "is missing");
    return axis.unit.to_si(*number);
  };
  axis.max_speed = positive("max_speed");
  axis.speed = reader.has("speed") ? positive("speed") : axis.max_speed;
  if (axis.speed > axis.max_speed) reader.fail("speed", "is above max_speed");
  axis.resolution = positive("resolution");
  reader.finish();
  return axis;
}

void read_axes(TableReader& all, Declaration& declaration, const UnitLookup& units) {
  const bool rotary = declaration.kind == "rotation_stage";
  const bool one_axis = rotary || declaration.kind == "lens_mover";
  if (declaration.kind != "stage" && !one_axis) return;
  for (TableReader& one : all.list("axes"))
    declaration.axes.push_back(read_axis(one, units, rotary ? "rad" : "m"));
  if (declaration.axes.empty())
    all.fail("axes", "is missing: { { name = \"x\", unit = \"mm\", travel = { 0, 25 }, ... } }");
  if (one_axis && declaration.axes.size() != 1) all.fail("axes", "must be one");
  if (declaration.axes.size() > 3) all.fail("axes", "must be three at most");
  declaration.starts_within = all.seconds("starts_within", 0, 10);
}

void read_role_numbers(TableReader& all, Declaration& declaration, const UnitLookup& units) {
  const std::string& kind = declaration.kind;
  const auto must = [&](const char* key, const std::optional<double>& number) {
    if (!number) all.fail(key, "is missing: " + kind + " wants it");
    declaration.numbers[key] = *number;
  };
  const auto role_unit = [&](const char* si) {
    declaration.unit = read_unit(all, units);
    if (declaration.unit.symbol.empty()) declaration.unit.si = si;
    if (declaration.unit.si != si) all.fail("unit", std::string("must be one of ") + si);
  };
  if (kind == "coils" || kind == "current_sensor") role_unit("A");
  if (kind == "field_probe") role_unit("T");
  if (kind == "coils" || kind == "lamp")
    if (!has_safe_state(declaration))
      all.fail("make_safe", "is missing: " + kind + " have a safe state");
  if (kind == "coils") {
    must("channels", all.whole("channels", 1, 64));
    must("current_limit", all.number("current_limit", 1e-3, 1000));  // A
  }
  if (kind == "field_probe") {
    must("axis_count", all.whole("axis_count", 1, 3));
    must("range", all.number("range", 1e-9, 100));  // T
    if (declaration.numbers["axis_count"] == 2) all.fail("axis_count", "must be 1 or 3");
  }
  if (kind == "current_sensor") {
    for (const double coil : all.numbers("coils"))
      declaration.coils.push_back(
          coil >= 1 && coil <= 64 && coil == std::floor(coil) ? static_cast<int>(coil) : 0);
    const std::set<int> each(declaration.coils.begin(), declaration.coils.end());
    if (declaration.coils.empty() || each.size() != declaration.coils.size() || *each.begin() < 1)
      all.fail("coils", "must be the coils that it measures, from 1, no coil twice");
  }
}

RescueDeclaration read_rescue(TableReader& all) {
  RescueDeclaration rescue;
  auto reader = all.table("rescue");
  if (!reader) return rescue;
  rescue.identify = reader->texts("identify");
  if (rescue.identify.size() != 2)
    reader->fail("identify", "must be { question, what its answer begins with }");
  rescue.send = reader->texts("send");
  if (rescue.send.empty()) reader->fail("send", "must be the messages that bring it to zero");
  const std::vector<std::string> check = reader->texts("check");
  if (check.size() % 2 != 0)
    reader->fail("check", "must be { question, answer wanted, question, answer wanted, ... }");
  for (std::size_t i = 0; i < check.size(); i += 2)
    rescue.check.emplace_back(check[i], check[i + 1]);
  reader->finish();
  return rescue;
}

void read_identity(TableReader& all, Declaration& declaration) {
  if (all.has("identity")) {
    try {
      declaration.identity = all.action("identity");
      return;
    } catch (const ScriptFault&) {  // a table then
    }
  }
  auto reader = all.table("identity");
  if (!reader)
    all.fail("identity", "is missing: \"*IDN?\", { ask = ..., match = ... } or a function(io)");
  declaration.identity = reader->action("ask");
  if (!is_there(declaration.identity)) reader->fail("ask", "is missing");
  declaration.identity_match = reader->text("match", "");
  declaration.identity_tries = static_cast<int>(reader->number("tries", 1, 3).value_or(1));
  declaration.identity_fields = reader->texts("fields");
  for (const std::string& field : declaration.identity_fields)
    if (field != "name" && field != "serial" && field != "firmware" && field != "_")
      reader->fail("fields", "must be of name, serial, firmware and _");
  reader->finish();
}

void read_errors(TableReader& all, Declaration& declaration) {
  if (!all.has("errors")) return;
  auto reader = all.table("errors");
  declaration.errors = reader->action("ask");
  declaration.no_error = reader->text("none", "^%+?0");
  if (!is_there(declaration.errors)) reader->fail("ask", "is missing");
  reader->finish();
}

/// make_safe = { on = false, set_point = 20 }: properties, in their declared units.
void read_safe_values(TableReader& table, Declaration& declaration) {
  for (const std::string& name : table.keys()) {
    const auto found = std::find_if(
        declaration.properties.begin(), declaration.properties.end(),
        [&](const PropertyDeclaration& one) { return one.info.name == name && one.info.settable; });
    if (found == declaration.properties.end()) table.fail(name, "is no property that can be set");
    const QuantityValue value = *table.value(name);
    if (value.index() != (found->info.type == QuantityType::flag     ? 1U
                          : found->info.type == QuantityType::text   ? 2U
                          : found->info.type == QuantityType::number ? 0U
                                                                     : 3U))
      table.fail(name, "is of another type than the property");
    const auto code = found->choices.find(
        std::holds_alternative<std::string>(value) ? std::get<std::string>(value) : "");
    if (!found->choices.empty() && code == found->choices.end())
      table.fail(name, "is none of the property's choices");
    // The instrument's own word in place of the choice's name: nothing is looked up when it
    // matters.
    declaration.safe_values.emplace_back(found - declaration.properties.begin(),
                                         found->choices.empty() ? value : code->second);
  }
}

void read_make_safe(TableReader& all, Declaration& declaration) {
  if (!all.has("make_safe")) return;
  try {
    declaration.make_safe = all.action("make_safe");
  } catch (const ScriptFault&) {
    if (auto table = all.table("make_safe"); table && !table->keys().empty())
      return read_safe_values(*table, declaration);
    declaration.safe = all.texts("make_safe");
  }
  if (const auto* one = std::get_if<std::string>(&declaration.make_safe)) {
    declaration.safe = {*one};
    declaration.make_safe = {};
  }
}

void read_functions(TableReader& all, Declaration& declaration) {
  const RoleShape& shape = shape_of(declaration.kind);
  for (const char* name : shape.must) {
    declaration.functions[name] = all.function(name);
    if (!declaration.functions[name])
      all.fail(name, "is missing: a " + declaration.kind + " has a function of that name");
  }
  for (const char* name : shape.may)
    if (all.has(name)) declaration.functions[name] = all.function(name);
}

const PropertyDeclaration* find(const Declaration& declaration, const std::string& name) {
  for (const PropertyDeclaration& one : declaration.properties)
    if (one.info.name == name) return &one;
  return nullptr;
}

/// What a free kind promises to protocols that ask for it by kind.
void check_free_kind(TableReader& all, const Declaration& declaration) {
  const std::string& kind = declaration.kind;
  const auto wants = [&](const char* name, bool readable, bool settable) {
    const PropertyDeclaration* const found = find(declaration, name);
    if (found == nullptr || (readable && !found->info.readable) ||
        (settable && !found->info.settable))
      all.fail("properties", "a " + kind + " has one called " + name + " that can be " +
                                 (readable ? "read" : "set"));
    return found;
  };
  bool energizes = false;
  if (kind == "sensor") wants("value", true, false);
  if (kind == "actuator") wants("set_point", false, true), energizes = true;
  if (kind == "switch") wants("on", false, true), energizes = true;
  if (kind == "pump") wants("rate", false, true), energizes = true;
  if (kind == "interlock_input") {
    const auto* closed = wants("closed", true, false);
    if (closed->info.type != QuantityType::flag || closed->info.every == Time::zero())
      all.fail("properties.closed", "must be a flag that is asked for by itself (every = 0.1)");
  }
  if (energizes && !has_safe_state(declaration))
    all.fail("make_safe", "is missing: a " + kind + " has a safe state");
}

/// What has an output is not left to itself: its run ends.
void read_on_silence(TableReader& all, Declaration& declaration) {
  const std::string& kind = declaration.kind;
  const bool energizes = kind == "actuator" || kind == "pump" || kind == "switch";
  declaration.on_silence = read_enum(all, "on_silence", {"note", "alarm", "stop", "abort"},
                                     energizes ? OnSilence::stop : OnSilence::alarm);
}

Declaration read(Sandbox& sandbox, const UnitLookup& units) {
  lua_State* const L = sandbox.stack();
  if (lua_type(L, -1) != LUA_TTABLE) {
    lua_pop(L, 1);
    throw ScriptFault(sandbox.file() + ": must return a table");
  }
  TableReader all(sandbox, "");
  Declaration declaration;
  declaration.title = all.text("title", "");
  if (declaration.title.empty()) all.fail("title", "is missing: what it is, in one line");
  declaration.kind = all.text("kind", "instrument");
  if (std::find(kinds().begin(), kinds().end(), declaration.kind) == kinds().end()) {
    std::string known;
    for (const std::string& one : kinds()) known += (known.empty() ? "" : ", ") + one;
    all.fail("kind", "must be one of " + known);
  }
  declaration.measures = all.text("measures", "");
  declaration.link = read_link(all);
  read_identity(all, declaration);
  declaration.setup = all.texts("setup");
  declaration.start_up = all.function("start_up");
  declaration.unasked = all.function("unasked");
  read_errors(all, declaration);
  if (auto properties = all.table("properties"))
    for (const std::string& name : properties->keys())
      // By name in alphabetical order: indices of the record and of handles follow it.
      declaration.properties.push_back(
          read_property(*properties, name, units, declaration.link.framing));
  if (auto commands = all.table("commands"))
    for (const std::string& name : commands->keys())
      declaration.commands.push_back(read_command(*commands, name, units));
  // Behind the properties, whose names and types a table of safe values refers to; before what asks
  // whether there is a safe state.
  read_make_safe(all, declaration);
  read_functions(all, declaration);
  read_axes(all, declaration, units);
  read_role_numbers(all, declaration, units);
  declaration.rescue = read_rescue(all);
  if (is_free(declaration.kind)) check_free_kind(all, declaration);
  read_on_silence(all, declaration);
  if (auto emulator = all.table("emulator")) declaration.emulator = emulator->reference();
  all.finish();
  return declaration;
}

}  // namespace

const std::vector<std::string>& kinds() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const RoleShape& one : shapes()) all.emplace_back(one.kind);
    return all;
  }();
  return names;
}

bool has_safe_state(const Declaration& declaration) {
  return is_there(declaration.make_safe) || !declaration.safe.empty() ||
         !declaration.safe_values.empty();
}

bool is_free(std::string_view kind) {
  return std::any_of(shapes().begin(), shapes().end(),
                     [&](const RoleShape& one) { return kind == one.kind && one.must.empty(); });
}

Loaded load(const std::string& file, const std::string& text, const UnitLookup& units,
            const SettingValues& values) {
  Loaded loaded{std::make_unique<Sandbox>(file), {}};
  Sandbox& sandbox = *loaded.sandbox;
  Asked asked{&sandbox, &units, &values};
  lua_State* const L = sandbox.stack();
  // `asked` does not outlive this call, and the script may keep the function.
  // NOLINTNEXTLINE(bugprone-sizeof-expression): the pointer's own size.
  auto* const open = static_cast<Asked**>(lua_newuserdatauv(L, sizeof(Asked*), 0));
  *open = &asked;
  lua_pushcclosure(L, declare_settings, 1);
  const Reference kept = (lua_pushvalue(L, -1), Reference(L));  // and with it `open`
  lua_setglobal(L, "settings");
  sandbox.run(text);
  *open = nullptr;
  loaded.declaration = read(sandbox, units);
  loaded.declaration.settings = std::move(asked.declared);
  return loaded;
}

}  // namespace vitreo::scripted
