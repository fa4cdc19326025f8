// SPDX-License-Identifier: Apache-2.0
#include "host/rig/interview/rig_draft.h"

#include "host/text/lua_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

namespace vitreo {
namespace {

/// The table in which a dotted key stands, and its last part.
ConfigTable& table_for(ConfigTable& table, std::string& key) {
  const std::size_t dot = key.find('.');
  if (dot == std::string::npos) return table;
  const std::string head = key.substr(0, dot);
  key = key.substr(dot + 1);
  ConfigValue& below = table.try_emplace(head, ConfigValue{ConfigTable{}}).first->second;
  return table_for(std::get<ConfigTable>(below.value), key);
}

std::string one_line(const std::string& text) {
  std::string line = text;
  std::replace_if(
      line.begin(), line.end(), [](unsigned char c) { return c < ' '; }, ' ');
  return line;
}

/// "-- ..." broken at the width of the project's Lua files.
std::string comment_lines(const std::string& text, const std::string& indent) {
  constexpr std::size_t kWidth = 96;
  std::string lines, line;
  std::string rest = one_line(text) + " ";
  for (std::size_t at; (at = rest.find(' ')) != std::string::npos; rest.erase(0, at + 1)) {
    const std::string word = rest.substr(0, at);
    if (!line.empty() && indent.size() + 4 + line.size() + word.size() > kWidth) {
      lines += indent + "-- " + line + "\n";
      line.clear();
    }
    line += (line.empty() || word.empty() ? "" : " ") + word;
  }
  return lines + (line.empty() ? "" : indent + "-- " + line + "\n");
}

/// The comment behind the code, above it where the line would be too long.
std::string line_of(const std::string& code, const std::string& comment) {
  constexpr std::size_t kLongest = 110;
  if (comment.empty()) return code + "\n";
  if (code.size() + comment.size() + 4 > kLongest)
    return comment_lines(comment, "    ") + code + "\n";
  return code + " -- " + one_line(comment) + "\n";
}

/// The settings from `at` on that stand in one inner table, as one line: z = { device = 1 },
std::string inner_line(const DraftTable& table, std::size_t& at) {
  const std::string head = table.settings[at].key.substr(0, table.settings[at].key.find('.') + 1);
  std::vector<std::string> parts, comments;
  for (; at < table.settings.size() && table.settings[at].key.starts_with(head); ++at) {
    const DraftSetting& one = table.settings[at];
    parts.push_back(one.key.substr(head.size()) + " = " + one.value.lua);
    if (!one.comment.empty()) comments.push_back(one.comment);
  }
  return line_of(
      fmt::format("    {} = {{ {} }},", head.substr(0, head.size() - 1), fmt::join(parts, ", ")),
      fmt::format("{}", fmt::join(comments, "; ")));
}

std::string table_text(const DraftTable& table) {
  std::string text = "\n";
  for (const std::string& comment : table.comments) text += comment_lines(comment, "  ");
  text += "  " + table.name + " = {\n";
  for (std::size_t at = 0; at < table.settings.size();) {
    const DraftSetting& one = table.settings[at];
    if (one.key.find('.') != std::string::npos) {
      text += inner_line(table, at);
      continue;
    }
    text += line_of(fmt::format("    {} = {},", one.key, one.value.lua), one.comment);
    ++at;
  }
  return text + "  },\n";
}

/// local A, mm = units.A, units.mm
std::string units_text(const RigDraft& draft) {
  std::set<std::string> names;
  for (const DraftTable& table : draft.tables)
    for (const DraftSetting& one : table.settings)
      names.insert(one.value.units.begin(), one.value.units.end());
  if (names.empty()) return "";
  std::vector<std::string> fields;
  for (const std::string& name : names) fields.push_back("units." + name);
  return fmt::format("local units = require \"units\"\nlocal {} = {}\n\n", fmt::join(names, ", "),
                     fmt::join(fields, ", "));
}

}  // namespace

const DraftSetting* DraftTable::find(const std::string& key) const {
  const auto found = std::find_if(settings.begin(), settings.end(),
                                  [&](const DraftSetting& one) { return one.key == key; });
  return found == settings.end() ? nullptr : &*found;
}

void DraftTable::set(DraftSetting setting) {
  const auto there = std::find_if(settings.begin(), settings.end(),
                                  [&](const DraftSetting& one) { return one.key == setting.key; });
  if (there == settings.end())
    settings.push_back(std::move(setting));
  else
    *there = std::move(setting);
}

const DraftTable* RigDraft::find(const std::string& name) const {
  const auto found = std::find_if(tables.begin(), tables.end(),
                                  [&](const DraftTable& one) { return one.name == name; });
  return found == tables.end() ? nullptr : &*found;
}

DraftTable* RigDraft::find(const std::string& name) {
  return const_cast<DraftTable*>(std::as_const(*this).find(name));
}

DraftTable& RigDraft::table(const std::string& name) {
  if (DraftTable* const there = find(name)) return *there;
  tables.push_back({name, {}, {}});
  return tables.back();
}

RigDescription description_of(const RigDraft& draft) {
  RigDescription rig;
  rig.file = draft.file;
  rig.folders = draft.folders;
  rig.table["title"] = {draft.title};
  for (const DraftTable& table : draft.tables) {
    ConfigTable values;
    for (const DraftSetting& one : table.settings) {
      std::string key = one.key;
      ConfigTable& place = table_for(values, key);
      place[key] = one.value.value;
    }
    rig.table[table.name] = {values};
  }
  return rig;
}

std::string to_lua(const RigDraft& draft) {
  std::string text =
      comment_lines(draft.title + ", made by `vitreo new rig` on " + draft.today + ".", "") +
      "-- All settings: vitreo docs instruments.\n" + units_text(draft) +
      "return {\n  title = " + lua_quoted(draft.title) + ",\n";
  for (const DraftTable& table : draft.tables) text += table_text(table);
  return text + "}\n";
}

}  // namespace vitreo
