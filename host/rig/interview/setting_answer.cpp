// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/setting_answer.h"

#include "host/text/columns.h"
#include "host/text/lua_text.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

using Kind = KnownSetting::Kind;

std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

std::string in_quotes(std::string_view text) { return "'" + std::string(text) + "'"; }

/// "12", "mm" of "12 mm"; the unit is empty where there is none. Nothing for what is no quantity.
struct Split {
  double number;
  std::string unit;  // as the units' table writes it
};
std::optional<Split> split(std::string_view text) {
  const auto whole = parse_quantity(text);
  if (!whole) return std::nullopt;
  if (whole->bare) return Split{whole->value, ""};
  // The shortest number behind which a unit stands: "1e3 m" has no unit "e3 m".
  for (std::size_t end = 1; end < text.size(); ++end) {
    const auto number = parse_quantity(text.substr(0, end));
    std::string_view symbol = trimmed(text.substr(end));
    if (symbol.starts_with('*')) symbol = trimmed(symbol.substr(1));
    const auto unit = find_unit(symbol);
    if (number && number->bare && unit && !symbol.empty())
      return Split{number->value, std::string(unit->symbol)};
  }
  return std::nullopt;
}

/// "mm / s" with its names in `used`, "mm_per_s" where a part of it is no unit of its own.
std::string lua_unit(const std::string& symbol, std::vector<std::string>& used) {
  const std::size_t slash = symbol.find('/');
  const auto is_named = [](std::string_view part) {
    return find_unit(part).has_value() && !unit_name(part).empty() && unit_name(part) == part;
  };
  if (slash != std::string::npos && is_named(symbol.substr(0, slash)) &&
      is_named(symbol.substr(slash + 1))) {
    used.push_back(symbol.substr(0, slash));
    used.push_back(symbol.substr(slash + 1));
    return used[used.size() - 2] + " / " + used.back();
  }
  used.push_back(unit_name(symbol));
  return used.back();
}

/// A unit that a person may have meant, for the error: that of the default, as people read it.
std::string unit_example(const KnownSetting& setting) {
  const nlohmann::json& usual = setting.fallback.is_array() && !setting.fallback.empty()
                                    ? setting.fallback.front()
                                    : setting.fallback;
  const double size = usual.is_number() ? usual.get<double>() : 0;
  return show_quantity(size != 0 ? size : setting.max, setting.unit).unit;
}

[[noreturn]] void refuse(const KnownSetting& setting, std::string_view typed) {
  throw ConfigError(in_quotes(typed) + " is not understood: it wants " + wanted_answer(setting));
}

/// Without a unit only a plain number, or zero, is clear: 5 could be mm or m.
WrittenValue quantity_of(const KnownSetting& setting, std::string_view typed) {
  const auto read = split(typed);
  if (!read) refuse(setting, typed);
  const std::optional<Unit> unit = find_unit(read->unit);
  if (!read->unit.empty() && std::string(unit->dimension) != setting.unit)
    throw ConfigError(fmt::format("{} is {}: it wants {}", in_quotes(typed), unit->quantity,
                                  wanted_answer(setting)));
  if (read->unit.empty() && !setting.unit.empty() && read->number != 0)
    throw ConfigError(fmt::format("{} needs its unit, such as {} {}", in_quotes(typed), typed,
                                  unit_example(setting)));
  WrittenValue written{{unit->to_si(read->number)}, fmt::format("{}", read->number), {}};
  // Percent and temperatures in °C have no factor in Lua.
  if (read->unit.empty() || read->number == 0) return written;
  if (unit_name(read->unit).empty() || unit->offset != 0)
    written.lua = fmt::format("{}", unit->to_si(read->number));
  else
    written.lua += " * " + lua_unit(read->unit, written.units);
  return written;
}

std::vector<std::string> parts_of(std::string_view typed) {
  std::vector<std::string> parts;
  while (!trimmed(typed).empty()) {
    const std::size_t end = typed.find_first_of(",;");
    parts.emplace_back(trimmed(typed.substr(0, end)));
    if (end == std::string_view::npos) break;
    typed.remove_prefix(end + 1);
  }
  return parts;
}

/// "-12, -12, -5 mm": the last one's unit holds for those before it that have none.
void spread_unit(std::vector<std::string>& parts) {
  const auto last = parts.empty() ? std::nullopt : split(parts.back());
  if (!last || last->unit.empty()) return;
  for (std::string& part : parts)
    if (const auto one = split(part); one && one->unit.empty()) part += " " + last->unit;
}

WrittenValue list_of(const KnownSetting& setting, std::string_view typed) {
  std::vector<std::string> parts =
      trimmed(typed) == "none" ? std::vector<std::string>{} : parts_of(typed);
  spread_unit(parts);
  if (setting.count > 0 && parts.size() != setting.count)
    throw ConfigError(fmt::format("{} has {} where {} are wanted: {}", in_quotes(typed),
                                  parts.size(), setting.count, wanted_answer(setting)));
  ConfigList values;
  std::vector<std::string> texts;
  WrittenValue written;
  for (const std::string& part : parts) {
    const WrittenValue one = quantity_of(setting, part);
    values.push_back(one.value);
    texts.push_back(one.lua);
    written.units.insert(written.units.end(), one.units.begin(), one.units.end());
  }
  written.value.value = values;
  written.lua = texts.empty() ? "{}" : fmt::format("{{ {} }}", fmt::join(texts, ", "));
  return written;
}

WrittenValue flag_of(const KnownSetting& setting, std::string_view typed) {
  const std::string word(typed);
  for (const char* yes : {"yes", "y", "true"})
    if (word == yes) return {{true}, "true", {}};
  for (const char* no : {"no", "n", "false"})
    if (word == no) return {{false}, "false", {}};
  refuse(setting, typed);
}

WrittenValue choice_of(const KnownSetting& setting, std::string_view typed) {
  const std::string word(typed);
  if (std::find(setting.choices.begin(), setting.choices.end(), word) != setting.choices.end())
    return written_text(word);
  const std::string near = nearest(word, setting.choices);
  throw ConfigError(in_quotes(typed) + " is none of " +
                    fmt::format("{}", fmt::join(setting.choices, ", ")) +
                    (near.empty() ? "" : "; did you mean " + near + "?"));
}

std::string typed_quantity(const nlohmann::json& value, const std::string& unit) {
  return plain_quantity(value.get<double>(), unit, 6);
}

/// "a current, 0.1 to 20 A".
std::string wanted_number(const KnownSetting& setting) {
  const std::string what = setting.kind == Kind::integer ? "a whole number"
                           : setting.unit.empty()        ? "a number"
                                                         : quantity_name(setting.unit);
  const bool bounded = std::isfinite(setting.min) && std::isfinite(setting.max);
  return bounded ? what + ", " + format_range(setting.min, setting.max, setting.unit, 6) : what;
}

}  // namespace

WrittenValue written_text(const std::string& text) { return {{text}, lua_quoted(text), {}}; }
WrittenValue written_number(double plain) { return {{plain}, fmt::format("{}", plain), {}}; }

WrittenValue read_setting(const KnownSetting& setting, std::string_view typed) {
  typed = trimmed(typed);
  switch (setting.kind) {
    case Kind::number:
    case Kind::integer:
      return quantity_of(setting, typed);
    case Kind::numbers:
      return list_of(setting, typed);
    case Kind::flag:
      return flag_of(setting, typed);
    case Kind::choice:
      return choice_of(setting, typed);
    case Kind::text:
    case Kind::texts:
      break;
  }
  return written_text(typed == "none" ? "" : std::string(typed));
}

std::string as_typed(const KnownSetting& setting, const std::string& in_si) {
  const auto read = parse_quantity(in_si);
  const bool quantity = read && read->bare && !setting.unit.empty();
  return quantity ? typed_quantity(read->value, setting.unit) : in_si;
}

std::string typed_default(const KnownSetting& setting) {
  const nlohmann::json& value = setting.fallback;
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_number()) return typed_quantity(value, setting.unit);
  if (value.is_string()) return value.get<std::string>().empty() ? "none" : value;
  std::vector<std::string> parts;
  for (const auto& one : value) parts.push_back(typed_quantity(one, setting.unit));
  return parts.empty() ? "none" : fmt::format("{}", fmt::join(parts, ", "));
}

std::string wanted_answer(const KnownSetting& setting) {
  switch (setting.kind) {
    case Kind::number:
    case Kind::integer:
      return wanted_number(setting);
    case Kind::numbers:
      return setting.count > 0 ? fmt::format("{} numbers with commas between, each {}",
                                             setting.count, wanted_number(setting))
                               : "numbers with commas between, or none";
    case Kind::flag:
      return "yes or no";
    case Kind::choice:
      return fmt::format("one of {}", fmt::join(setting.choices, ", "));
    case Kind::text:
    case Kind::texts:
      break;
  }
  return "a text";
}

}  // namespace vitreo
