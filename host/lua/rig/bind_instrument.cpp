// Bindings of instruments of free kinds: a class for each, made from what it declares.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"

#include <algorithm>
#include <memory>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr double kUsualAnswer = 10;     // s
constexpr double kLongestReload = 300;  // s: two openings, of 120 s at most
const std::string kSetter = "set_";

/// Looked for in the job itself: a reload in between may have moved it.
template <class List>
std::size_t index_of(const List& list, const std::string& name) {
  const auto found =
      std::find_if(list.begin(), list.end(), [&](const auto& one) { return one.name == name; });
  if (found == list.end()) throw std::invalid_argument(name + ": is not there since a reload");
  return static_cast<std::size_t>(found - list.begin());
}

int push(Call& call, const QuantityValue& value, const std::string& unit) {
  if (const auto* number = std::get_if<double>(&value)) return call.result(*number, unit.c_str());
  if (const auto* flag = std::get_if<bool>(&value)) return call.flag(*flag);
  if (const auto* list = std::get_if<std::vector<double>>(&value))
    return call.result(*list, unit.c_str());
  return call.result(std::get<std::string>(value));
}

QuantityValue value_at(const Call& call, std::size_t argument, QuantityType type) {
  switch (type) {
    case QuantityType::number:
      return call.number(argument);
    case QuantityType::flag:
      return lua_toboolean(call.L, call.index(argument)) != 0;
    case QuantityType::numbers:
      return call.numbers(argument);
    case QuantityType::text:
      break;
  }
  return call.text(argument);
}

// The pointer is the rig's, whose proxy stays through a reload; the index is looked up in the job.
int read_quantity(Call& call) {
  Instrument* const instrument = &call.self<Instrument>();
  auto sample = std::make_shared<QuantitySample>();
  const Time limit = from_seconds(kUsualAnswer);
  return call.wait(work(
      call, instrument->info().identity.name,
      [=, name = call.binding.name] {
        *sample = instrument->read(index_of(instrument->info().quantities, name), limit);
      },
      2 * limit,
      [sample](Call& done) { return push(done, sample->value, done.binding.returns.unit); }));
}

int set_quantity(Call& call) {
  Instrument* const instrument = &call.self<Instrument>();
  const std::string name = call.binding.name.substr(kSetter.size());
  const auto& all = instrument->info().quantities;
  // Taken off the Lua stack now: the job runs while the script's coroutine sleeps.
  const QuantityValue value = value_at(call, 0, all[index_of(all, name)].type);
  return call.wait(work(
      call, instrument->info().identity.name,
      [=] { instrument->set(index_of(instrument->info().quantities, name), value); },
      from_seconds(2 * kUsualAnswer), [](Call&) { return 0; }));
}

int run_command(Call& call) {
  Instrument* const instrument = &call.self<Instrument>();
  const auto& all = instrument->info().commands;
  const std::string name = call.binding.name;
  const std::size_t index = index_of(all, name);
  std::vector<QuantityValue> arguments;
  for (std::size_t i = 0; i < all[index].arguments.size(); ++i)
    arguments.push_back(value_at(call, i, all[index].arguments[i].type));
  return call.wait(work(
      call, instrument->info().identity.name,
      [=] { instrument->command(index_of(instrument->info().commands, name), arguments); },
      // Beyond what the driver itself allows, whose error says more than that of the wait.
      2 * all[index].longest + from_seconds(1), [](Call&) { return 0; }));
}

int make_safe(Call& call) {
  Instrument* const instrument = &call.self<Instrument>();
  return call.wait(work(
      call, instrument->info().identity.name, [=] { instrument->make_safe(); },
      from_seconds(2 * kUsualAnswer), [](Call&) { return 0; }));
}

int instrument_info(Call& call) {
  const InstrumentInfo& info = call.self<Instrument>().info();
  ResultTable table(call);
  set_identity(table, info.identity);
  table.text("kind", info.kind).text("measures", info.measures);
  return 1;
}

Argument argument_of(const QuantityInfo& info) {
  Argument argument{.name = info.name, .unit = info.unit, .help = info.help};
  argument.choices = info.choices;
  switch (info.type) {
    case QuantityType::number:
      argument.type = Type::number;
      argument.min = info.min;
      argument.max = info.max;
      break;
    case QuantityType::flag:
      argument.type = Type::flag;
      break;
    case QuantityType::text:
      argument.type = Type::text;
      break;
    case QuantityType::numbers:
      argument.type = Type::numbers;
      break;
  }
  return argument;
}

Returned returned(const QuantityInfo& info) {
  switch (info.type) {
    case QuantityType::number:
      return {"number", info.unit.c_str()};
    case QuantityType::flag:
      return {"true or false"};
    case QuantityType::numbers:
      return {"list of numbers", info.unit.c_str()};
    case QuantityType::text:
      break;
  }
  return {"text"};
}

/// One line: "the temperature; asked for each 0.1 s, and recorded".
std::string doc_of(const QuantityInfo& info) {
  std::string doc = info.help.empty() ? "its " + info.name : info.help;
  if (info.every > Time::zero())
    doc += "; recorded each " + std::to_string(to_seconds(info.every)).substr(0, 5) + " s";
  return doc;
}

/// Help, completion and checks of arguments are the binding's own, made of the declaration: an
/// instrument of a file is called as any role of the program's.
Class class_of(const std::string& role, const InstrumentInfo& info) {
  Class made;
  made.name = "rig." + role;
  made.doc = to_string(info.identity) + ", " + info.kind +
             (info.measures.empty() ? "" : " of " + info.measures);
  made.methods.push_back({"info",
                          {},
                          {"table", identity_fields({{"kind", "", ""}, {"measures", "", ""}})},
                          "what instrument it is",
                          instrument_info});
  made.methods.push_back({"make_safe", {}, "", "its safe state", make_safe});
  for (const QuantityInfo& one : info.quantities) {
    if (one.readable)
      made.methods.push_back({one.name, {}, returned(one), doc_of(one), read_quantity});
    if (one.settable) {
      Argument value = argument_of(one);
      made.methods.push_back({kSetter + one.name,
                              {std::move(value)},
                              "",
                              one.help.empty() ? "sets its " + one.name : "sets: " + one.help,
                              set_quantity});
    }
  }
  for (const CommandInfo& one : info.commands) {
    std::vector<Argument> arguments;
    for (const QuantityInfo& argument : one.arguments) arguments.push_back(argument_of(argument));
    made.methods.push_back({one.name, std::move(arguments), "",
                            one.help.empty() ? "the command " + one.name : one.help, run_command});
  }
  return made;
}

/// The class is the state's own: another rig's instrument of the same name has another one. One
/// that is there already is replaced under its handles.
const Class& open_class_of(lua_State* L, const std::string& role, const Instrument& instrument) {
  const auto kind = std::make_shared<const Class>(class_of(role, instrument.info()));
  context_of(L).kept.push_back(kind);
  open_classes(L, {kind.get()});
  return *kind;
}

const FreeRole* free_role(const Rig& rig, const std::string& name) {
  for (const FreeRole& one : rig.free_roles)
    if (one.name == name) return &one;
  return nullptr;
}

/// "bath: Acme thermometer 0815, sensor of temperature"; of a role of the program's its name alone.
std::string shown_role(const Rig& rig, const std::string& name) {
  const FreeRole* const role = free_role(rig, name);
  auto* const* instrument = role == nullptr ? nullptr : std::get_if<Instrument*>(&role->device);
  return instrument == nullptr ? name : name + ": " + class_of(name, (*instrument)->info()).doc;
}

int reload(Call& call) {
  Session* const session = &session_of(call.L);
  if (!call.context().remembers_results || call.context().nested)
    throw std::runtime_error("is for the prompt: a run has the files that it began with");
  const std::string role = call.text(0);
  return call.wait(work(
      call, role, [=] { session->reload(role); }, from_seconds(kLongestReload),
      [=](Call& done) {
        if (const FreeRole* const found = free_role(session->rig, role))
          if (auto* const* instrument = std::get_if<Instrument*>(&found->device))
            open_class_of(done.L, role, **instrument);
        return done.result(shown_role(session->rig, role));
      }));
}

/// The handle that the rig has under that name.
int push_role(const Call& call, const std::string& name) {
  lua_getfield(call.L, call.index(0) - 1, name.c_str());
  return 1;
}

int instrument_of_kind(Call& call) {
  const Rig& rig = call.self<Rig>();
  const std::string need = call.text(0);
  const std::vector<std::string> names = rig.fitting(need);
  if (names.size() == 1) return push_role(call, names.front());
  std::string all;
  for (const std::string& name : names.empty() ? rig.roles() : names)
    all += (all.empty() ? "" : ", ") + name;
  throw std::runtime_error(names.empty() ? "this rig has no " + need + ", only " + all
                                         : "several are of the kind " + need + ": " + all +
                                               "; name one of them");
}

// The rig owns its devices and outlives the state: the handle frees nothing.
template <class T>
void push_borrowed(lua_State* L, const Class& kind, T* device) {
  push_handle(L, kind, std::shared_ptr<void>(device, [](void*) {}));
}

}  // namespace

std::vector<Binding> rig_instrument_rows() {
  return {
      {"instrument",
       {{.name = "need",
         .type = Type::text,
         .help = "as in a protocol's needs: \"sensor:temperature\", \"pump\", or a role's name"}},
       "any",
       "the one instrument that is of that kind, whatever its role is called; an error where "
       "there are several",
       instrument_of_kind,
       "rig:instrument(\"coils\")"},
      {"reload",
       {{.name = "role", .type = Type::text, .help = "of an instrument in Lua: \"heater\""}},
       "text",
       "at the prompt: reads the instrument's Lua file anew; handles stay, a file that is wrong "
       "changes nothing",
       reload,
       "rig:reload(\"heater\")"}};
}

void push_free_role(lua_State* L, const FreeRole& role) {
  if (auto* const* stage = std::get_if<Stage*>(&role.device))
    return push_borrowed(L, stage_class(), *stage);
  if (auto* const* stage = std::get_if<RotationStage*>(&role.device))
    return push_borrowed(L, rotation_stage_class(), *stage);
  if (auto* const* probe = std::get_if<FieldProbe*>(&role.device))
    return push_borrowed(L, field_probe_class(), *probe);
  if (auto* const* input = std::get_if<OperatorInput*>(&role.device))
    return push_borrowed(L, operator_input_class(), *input);
  Instrument* const instrument = std::get<Instrument*>(role.device);
  push_borrowed(L, open_class_of(L, role.name, *instrument), instrument);
}

}  // namespace vitreo::lua
