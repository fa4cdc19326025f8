// SPDX-License-Identifier: Apache-2.0
#include "host/rig/instrument_page.h"

#include "devices/links/printable.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <string_view>

namespace vitreo {
namespace {

using scripted::Declaration;
using scripted::DeclaredUnit;

std::string number_text(double number) { return fmt::format("{:.6g}", number); }

std::string bounds_text(const QuantityInfo& info, const DeclaredUnit& unit) {
  if (!info.choices.empty()) return fmt::format("{}", fmt::join(info.choices, ", "));
  if (info.type != QuantityType::number || !std::isfinite(info.max - info.min)) return "";
  return number_text(unit.from_si(info.min)) + " to " + number_text(unit.from_si(info.max));
}

const char* type_text(QuantityType type) {
  switch (type) {
    case QuantityType::flag:
      return "true, false";
    case QuantityType::text:
      return "text";
    case QuantityType::numbers:
      return "numbers";
    case QuantityType::number:
      break;
  }
  return "number";
}

std::string value_text(const QuantityValue& value) {
  if (const auto* number = std::get_if<double>(&value)) return number_text(*number);
  if (const auto* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const auto* text = std::get_if<std::string>(&value)) return "\"" + *text + "\"";
  return "a list";
}

std::string link_text(const Declaration& declared) {
  const scripted::LinkDeclaration& link = declared.link;
  std::string text = fmt::format("{}", fmt::join(link.buses, ", "));
  for (const std::string& bus : link.buses)
    if (bus == "serial") text += "; a serial line at " + to_string(link.serial);
  if (link.framing.kind == scripted::Framing::Kind::modbus)
    text +=
        fmt::format("; Modbus {}, unit {}",
                    link.framing.modbus == modbus::Framing::tcp ? "TCP" : "RTU", link.framing.unit);
  return text;
}

void add_settings(std::string& page, const Declaration& declared) {
  if (declared.settings.empty()) return;
  page += "\n| setting | unit | usual | bounds | |\n|---|---|---|---|---|\n";
  for (const scripted::SettingDeclaration& one : declared.settings) {
    std::string bounds = fmt::format("{}", fmt::join(one.choices, ", "));
    if (std::isfinite(one.max - one.min))
      bounds = number_text(one.min) + " to " + number_text(one.max);
    page += fmt::format("| `{}` | {} | {} | {} | {} |\n", one.name, one.unit.symbol,
                        value_text(one.fallback), bounds, one.help);
  }
}

void add_axes(std::string& page, const Declaration& declared) {
  if (declared.axes.empty()) return;
  page += "\n| axis | travel | speed | resolution |\n|---|---|---|---|\n";
  for (const scripted::AxisDeclaration& one : declared.axes)
    page += fmt::format("| {} | {} to {} {} | {} {}/s | {} {} |\n", one.name,
                        number_text(one.unit.from_si(one.travel_min)),
                        number_text(one.unit.from_si(one.travel_max)), one.unit.symbol,
                        number_text(one.unit.from_si(one.max_speed)), one.unit.symbol,
                        number_text(one.unit.from_si(one.resolution)), one.unit.symbol);
}

void add_quantities(std::string& page, const Declaration& declared) {
  if (declared.properties.empty()) return;
  page += "\n| quantity | | unit | when it is set | |\n|---|---|---|---|---|\n";
  for (const scripted::PropertyDeclaration& one : declared.properties) {
    std::string calls = one.info.readable ? fmt::format("`{}()`", one.info.name) : "";
    if (one.info.settable)
      calls += fmt::format("{}`set_{}(value)`", calls.empty() ? "" : ", ", one.info.name);
    std::string help = one.info.help;
    if (one.info.every > Time::zero())
      help += fmt::format("{}asked for each {:g} s, and recorded", help.empty() ? "" : "; ",
                          to_seconds(one.info.every));
    page += fmt::format("| {} | {} | {} | {} | {} |\n", calls, type_text(one.info.type),
                        one.unit.symbol, bounds_text(one.info, one.unit), help);
  }
}

void add_commands(std::string& page, const Declaration& declared) {
  if (declared.commands.empty()) return;
  page += "\n| command | arguments | |\n|---|---|---|\n";
  for (const scripted::CommandDeclaration& one : declared.commands) {
    std::string names, arguments;
    for (std::size_t i = 0; i < one.info.arguments.size(); ++i) {
      const QuantityInfo& info = one.info.arguments[i];
      names += (i == 0 ? "" : ", ") + info.name;
      arguments += fmt::format("{}{}: {} {}", i == 0 ? "" : "; ", info.name,
                               bounds_text(info, one.units[i]), one.units[i].symbol);
    }
    page += fmt::format("| `{}({})` | {} | {} |\n", one.info.name, names, arguments, one.info.help);
  }
}

std::string name_of(const InstrumentFile& file) {
  return std::filesystem::path(file.path).stem().string();
}

/// How a rig file names it.
std::string rig_line(const std::string& name, const Declaration& declared) {
  const std::string role = scripted::is_free(declared.kind) ? "my_" + name : declared.kind;
  return fmt::format("{} = {{ driver = \"{}\", address = \"{}:...\" }}", role, name,
                     declared.link.buses.empty() ? "serial" : declared.link.buses.front());
}

}  // namespace

std::string instrument_page(const InstrumentFile& file) {
  const scripted::Loaded loaded = load_instrument(file);
  const Declaration& declared = loaded.declaration;
  const std::string name = name_of(file);
  std::string page = fmt::format(
      "# {}\n\nKind: {}{}. In a rig file: `{}`{}\n\nLink: {}.\n", declared.title, declared.kind,
      declared.measures.empty() ? "" : " of " + declared.measures, rig_line(name, declared),
      declared.emulator ? ", or without an address, emulated." : ".", link_text(declared));
  if (const auto* question = std::get_if<std::string>(&declared.identity))
    page += "It is known by its answer to `" + printable(*question) + "`.\n";
  if (!declared.rescue.send.empty())
    page += "When the host is dead the guardian brings its output to zero.\n";
  add_settings(page, declared);
  add_axes(page, declared);
  add_quantities(page, declared);
  add_commands(page, declared);
  page +=
      "\nNumbers are in SI in scripts and in rig files. "
      "File: " +
      file.path + "\n";
  return page;
}

std::string instrument_list(const RigDescription& rig) {
  std::string text;
  for (const std::string& name : instrument_file_names(rig)) {
    const auto file = find_instrument_file(rig, "/nowhere/", name);
    if (!file) continue;
    const scripted::Loaded loaded = load_instrument(*file);
    text +=
        fmt::format("{:<18} {:<16} {}\n", name, loaded.declaration.kind, loaded.declaration.title);
  }
  return text + "\nvitreo docs instrument NAME prints its page, NAME.lua that of a file of yours\n";
}

}  // namespace vitreo
