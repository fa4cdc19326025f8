// SPDX-License-Identifier: Apache-2.0
#include "host/config/config_lines.h"

#include "host/config/lua_entries.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

/// The entries of a text by their paths, through variables.
class Paths {
 public:
  explicit Paths(std::vector<LuaEntry> entries) : entries_(std::move(entries)) {}

  /// The last of several is the one in effect. Null when there is none.
  /// Exact first. Then from the longest prefix to the shortest: where a table is a variable's, or
  /// what a function of the text returns, the rest of the path goes on there.
  const LuaEntry* find(const std::string& path, int depth = 0) const {
    if (const LuaEntry* const entry = stands(path, false)) return entry;
    constexpr int kMaxAliases = 8;  // a = b and b = a would go on for ever
    if (depth == kMaxAliases) return nullptr;
    for (std::size_t dot = path.rfind('.'); dot != std::string::npos && dot > 0;
         dot = path.rfind('.', dot - 1)) {
      const LuaEntry* const parent = stands(path.substr(0, dot), true);
      if (parent == nullptr) continue;
      if (const LuaEntry* const entry = find(parent->alias + path.substr(dot), depth + 1))
        return entry;
    }
    return nullptr;
  }

  /// A key of that name in a table that is not the returned one.
  /// For tables that a function or a loop makes: the first place that sets such a key is the best
  /// guess.
  const LuaEntry* find_elsewhere(const std::string& name) const {
    const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const LuaEntry& entry) {
      return !entry.path.starts_with(kReturnedRoot) && entry.path.ends_with("." + name);
    });
    return found == entries_.end() ? nullptr : &*found;
  }

 private:
  /// With an alias only, where one is wanted. A key that is computed, as in a loop, stands for any:
  /// after those that are written as they are.
  const LuaEntry* stands(const std::string& path, bool with_alias) const {
    for (const bool computed : {false, true}) {
      const auto found =
          std::find_if(entries_.rbegin(), entries_.rend(), [&](const LuaEntry& entry) {
            return (computed ? may_be(entry.path, path) : entry.path == path) &&
                   (!with_alias || !entry.alias.empty());
          });
      if (found != entries_.rend()) return &*found;
    }
    return nullptr;
  }

  /// Part by part; a part that is computed, on either side, may be any.
  static bool may_be(std::string_view a, std::string_view b) {
    while (!a.empty() && !b.empty()) {
      const std::string_view first = part(a), second = part(b);
      if (first != second && first != kComputedKey && second != kComputedKey) return false;
    }
    return a.empty() && b.empty();
  }

  /// Takes the first part off.
  static std::string_view part(std::string_view& path) {
    const std::size_t dot = std::min(path.find('.'), path.size());
    const std::string_view first = path.substr(0, dot);
    path.remove_prefix(std::min(dot + 1, path.size()));
    return first;
  }

  std::vector<LuaEntry> entries_;
};

/// Whether the entry's table stands in the text as it is, perhaps under a variable's name.
bool is_literal(const Paths& paths, const LuaEntry& entry) {
  if (entry.literal) return true;
  const LuaEntry* const variable = entry.alias.empty() ? nullptr : paths.find(entry.alias);
  return variable != nullptr && variable->literal;
}

}  // namespace

// Four answers, each less exact than the one before: the key itself; a key of that name elsewhere,
// if its table is computed; the line of its table; nothing.
int find_line(std::string_view text, std::string_view dotted_key) {
  const Paths paths(lua_entries(text));
  std::string path = kReturnedRoot + "." + std::string(dotted_key);
  if (const LuaEntry* const entry = paths.find(path)) return entry->line;
  const std::string last = path.substr(path.rfind('.') + 1);
  const LuaEntry* parent = nullptr;
  while (parent == nullptr && path.rfind('.') != std::string::npos) {
    path.resize(path.rfind('.'));
    parent = paths.find(path);
  }
  if (parent == nullptr || !is_literal(paths, *parent))
    if (const LuaEntry* const entry = paths.find_elsewhere(last)) return entry->line;
  return parent != nullptr && path != kReturnedRoot ? parent->line : 0;
}

}  // namespace vitreo
