// Declaration of an instrument: its properties and commands, their quantities and registers.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/declaration_parts.h"
#include "devices/scripted/lua_values.h"

#include <cmath>

namespace vitreo::scripted {
namespace {

bool is_name(const std::string& text) {
  return !text.empty() && text.size() <= 40 && (text[0] >= 'a' && text[0] <= 'z') &&
         std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
         });
}

QuantityType read_type(TableReader& reader, bool has_choices) {
  const std::string type = reader.text("type", has_choices ? "text" : "number");
  if (type == "number") return QuantityType::number;
  if (type == "flag") return QuantityType::flag;
  if (type == "text") return QuantityType::text;
  if (type == "numbers") return QuantityType::numbers;
  reader.fail("type", "must be number, flag, text or numbers");
}

/// choices = { "dc", "rms" }, or { dc = "1", rms = "2" }.
std::map<std::string, std::string> read_choices(TableReader& reader) {
  std::map<std::string, std::string> choices;
  auto table = reader.table("choices");
  if (!table) return choices;
  for (const std::string& name : table->keys()) {
    const auto code = table->value(name);
    if (const auto* text = std::get_if<std::string>(&*code))
      choices[name] = *text;
    else if (const auto* number = std::get_if<double>(&*code);
             number != nullptr && *number == std::floor(*number))
      choices[name] = std::to_string(std::llround(std::clamp(*number, -1e15, 1e15)));
    else
      table->fail(name, "must be what the instrument calls it: a text, or a whole number");
  }
  if (choices.empty())
    for (const std::string& name : reader.texts("choices")) choices[name] = name;
  if (choices.empty()) reader.fail("choices", "must not be empty");
  return choices;
}

QuantityInfo read_quantity(TableReader& reader, const std::string& name, const DeclaredUnit& unit,
                           const std::map<std::string, std::string>& choices,
                           const RegisterDeclaration* held = nullptr) {
  QuantityInfo info;
  info.name = name;
  if (held == nullptr)
    info.type = read_type(reader, !choices.empty());
  else if (held->format == RegisterFormat::flag)
    info.type = QuantityType::flag;
  info.unit = unit.si;
  info.help = reader.text("help", "");
  const auto min = reader.number("min", -kHuge, kHuge);
  const auto max = reader.number("max", -kHuge, kHuge);
  if (min) info.min = unit.to_si(*min);
  if (max) info.max = unit.to_si(*max);
  if (info.min > info.max) reader.fail("min", "is above max");
  if (!choices.empty() && info.type != QuantityType::text)
    reader.fail("choices", "are names, so that its type is text");
  for (const auto& [choice, code] : choices) info.choices.push_back(choice);
  return info;
}

// register = 0x0106, type = "i32", scale = 0.1, set = true: no message has to be written.
std::optional<RegisterDeclaration> read_register(TableReader& reader) {
  const auto address = reader.number("register", 0, 65535);
  if (!address) return std::nullopt;
  RegisterDeclaration held{.address = static_cast<int>(*address)};
  static const std::vector<std::string> tables{"coil", "discrete_input", "holding", "input"};
  static const std::vector<std::string> formats{"flag", "u16", "i16", "u32", "i32", "f32"};
  static const std::vector<std::string> orders{"high_first", "low_first"};
  held.table = read_enum(reader, "table", tables, held.table);
  const bool bit = held.table == RegisterTable::coil || held.table == RegisterTable::discrete_input;
  held.format =
      read_enum(reader, "type", formats, bit ? RegisterFormat::flag : RegisterFormat::u16);
  if (bit && held.format != RegisterFormat::flag)
    reader.fail("type", "must be flag: a coil and a discrete input are one bit");
  held.low_word_first = read_enum(reader, "words", orders, 0) == 1;
  held.scale = reader.number("scale", -kHuge, kHuge).value_or(1);
  if (held.scale == 0) reader.fail("scale", "must not be 0");
  return held;
}

/// Where a register is asked for and set by the host; a function of the file may do either.
void read_register_actions(TableReader& reader, PropertyDeclaration& property) {
  const auto wanted = [&](const char* key, bool usual) -> std::optional<Action> {
    if (!reader.has(key)) return usual ? std::optional<Action>(std::string()) : std::nullopt;
    try {
      if (!reader.flag(key, false)) return std::nullopt;
      return std::string();
    } catch (const ScriptFault&) {
      return reader.function(key);
    }
  };
  const RegisterDeclaration& held = *property.held;
  if (const auto ask = wanted("ask", true))
    property.ask = std::holds_alternative<std::string>(*ask) ? Action(read_request(held)) : *ask;
  if (const auto set = wanted("set", false)) property.set = *set;
  const bool by_host = std::holds_alternative<std::string>(property.set);
  if (by_host &&
      (held.table == RegisterTable::discrete_input || held.table == RegisterTable::input))
    reader.fail("set", "cannot be: such a register can only be read");
}

}  // namespace

DeclaredUnit read_unit(TableReader& reader, const UnitLookup& units, const std::string& key) {
  const std::string symbol = reader.text(key, "");
  if (symbol.empty()) return {};
  const auto found = units(symbol);
  if (!found)
    reader.fail(
        key,
        "\"" + symbol + "\" is no unit that is known: `vitreo docs instruments_in_lua` lists them");
  return *found;
}

void check_name(TableReader& reader, const std::string& name) {
  if (!is_name(name)) reader.fail(name, "a name has small letters, digits and _, at most 40");
}

PropertyDeclaration read_property(TableReader& all, const std::string& name,
                                  const UnitLookup& units, const Framing& framing) {
  check_name(all, name);
  auto reader = all.table(name);
  PropertyDeclaration property;
  property.unit = read_unit(*reader, units);
  property.held = read_register(*reader);
  if (property.held && framing.kind != Framing::Kind::modbus)
    reader->fail("register", "is of Modbus: link = { modbus = { unit = 1 } }");
  if (!property.held) property.choices = read_choices(*reader);
  property.info = read_quantity(*reader, name, property.unit, property.choices,
                                property.held ? &*property.held : nullptr);
  if (property.held) {
    read_register_actions(*reader, property);
  } else {
    property.ask = reader->action("ask");
    property.set = reader->action("set");
  }
  property.answer = reader->text("answer", "");
  property.expects = reader->text("expects", "");
  property.info.every = reader->seconds("every", 0, 3600);
  property.info.readable = is_there(property.ask);
  property.info.settable = is_there(property.set);
  if (!property.info.readable && !property.info.settable)
    reader->fail("ask", "neither ask nor set is there: what can be done with it?");
  if (property.info.every > Time::zero() && !property.info.readable)
    reader->fail("every", "is of what can be asked for");
  if (property.info.settable && property.info.type == QuantityType::number &&
      !std::isfinite(property.info.max - property.info.min))
    reader->fail("max", "a number that can be set has bounds: min and max");
  reader->finish();
  return property;
}

CommandDeclaration read_command(TableReader& all, const std::string& name,
                                const UnitLookup& units) {
  check_name(all, name);
  auto reader = all.table(name);
  CommandDeclaration command;
  command.info.name = name;
  command.info.help = reader->text("help", "");
  command.info.longest = reader->seconds("lasts", 10, 86400);
  command.send = reader->action("send");
  if (!is_there(command.send)) reader->fail("send", "is missing: a message, or a function(io)");
  command.expects = reader->text("expects", "");
  command.done = reader->function("done");
  constexpr std::size_t kMostArguments = 16;
  std::vector<TableReader> arguments = reader->list("arguments");
  if (arguments.size() > kMostArguments) reader->fail("arguments", "must be at most 16");
  for (TableReader& one : arguments) {
    const std::string argument = one.text("name", "");
    check_name(one, argument);
    command.units.push_back(read_unit(one, units));
    const auto& choices = command.choices.emplace_back(read_choices(one));
    command.info.arguments.push_back(read_quantity(one, argument, command.units.back(), choices));
    const QuantityInfo& info = command.info.arguments.back();
    if (info.type == QuantityType::number && !std::isfinite(info.max - info.min))
      one.fail("max", "a number has bounds: min and max");
    one.finish();
  }
  reader->finish();
  return command;
}

}  // namespace vitreo::scripted
