// SPDX-License-Identifier: Apache-2.0
#include "host/config/config_lines.h"

#include "host/config/lua_tokens.h"

#include <algorithm>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

using Kind = LuaToken::Kind;

constexpr int kMaxDepth = 100;  // of tables and functions: a hostile text must not end the stack

// Paths begin with a root: what the text returns, or "@" and a variable's name.
const std::string kReturned = "@return";

/// One key that gets a value.
/// Entries are in the order of the text. `line` is where the key stands, and not where its value
/// ends.
struct Entry {
  std::string path;  // "@return.top_camera.focus"
  int line;
  std::string alias{};   // the root and path of the variable that alone is its value
  bool literal = false;  // its value is a table constructor and nothing else
};

bool is_keyword(const std::string& name) {
  static const std::set<std::string> kKeywords{
      "and",      "break",  "do",   "else", "elseif", "end",  "false", "for",
      "function", "goto",   "if",   "in",   "local",  "nil",  "not",   "or",
      "repeat",   "return", "then", "true", "until",  "while"};
  return kKeywords.contains(name);
}

/// Reads as much of Lua's grammar as tells where a key gets its value: table constructors, chains
/// a.b["c"], assignments, and where the blocks of functions end.
class Reader {
 public:
  explicit Reader(std::string_view text) : tokens_(lua_tokens(text)) {}

  std::vector<Entry> entries() {
    while (at_ < tokens_.size()) statements(false, 0);
    return std::move(entries_);
  }

 private:
  // Tokens of strings never match, so that "end" in a text ends no block.
  bool is(const char* text, std::size_t ahead = 0) const {
    return at_ + ahead < tokens_.size() && tokens_[at_ + ahead].kind != Kind::text &&
           tokens_[at_ + ahead].text == text;
  }
  bool is_kind(Kind kind, std::size_t ahead = 0) const {
    return at_ + ahead < tokens_.size() && tokens_[at_ + ahead].kind == kind;
  }
  bool is_variable() const { return is_kind(Kind::name) && !is_keyword(tokens_[at_].text); }

  // Statements up to the `end` of the function whose body this is, or to the text's end.
  // `target` is the path under which a table constructor's keys are noted; "@" is that of a table
  // without a name, such as a call's argument, and only find_elsewhere() looks there.
  void statements(bool in_function, int depth) {
    std::string target;  // of the assignment that goes on
    int blocks = 0;
    while (at_ < tokens_.size()) {
      if (is("{")) {
        constructor(target, depth + 1);
      } else if (is("function")) {
        function(depth + 1);
      } else if (is("end") || is("until")) {
        ++at_;
        if (blocks-- == 0 && in_function) return;
      } else if (is("do") || is("if") || is("repeat")) {  // `while` and `for` have their `do`
        ++blocks;
        ++at_;
      } else if (is("return")) {
        target = in_function ? "@" : kReturned;
        const int line = tokens_[at_++].line;
        if (!in_function) keep(target, line, false);
      } else if (is_variable()) {
        variable(target);
      } else {
        ++at_;
      }
    }
  }

  void function(int depth) {
    ++at_;
    // The rest of the text is given up: its keys have no line.
    if (depth > kMaxDepth) {
      at_ = tokens_.size();
      return;
    }
    statements(true, depth);
  }

  // A chain in a statement: what is assigned, or a part of an expression.
  void variable(std::string& target) {
    const bool begins = at_ == 0 || !continues_expression();
    const std::string path = chain();
    while (is("<") && is_kind(Kind::name, 1) && is(">", 2)) at_ += 3;  // <const>, <close>
    if (is("=")) {
      const int line = tokens_[at_ - 1].line;
      ++at_;
      target = path;
      keep(target, line, false);
    } else if (begins) {
      target = "@";  // a call: its table is no one's
    }
  }

  // After these an operand belongs to the expression before it.
  bool continues_expression() const {
    const LuaToken& before = tokens_[at_ - 1];
    if (before.kind == Kind::symbol)
      return before.text != ")" && before.text != "]" && before.text != "}" && before.text != ";";
    return before.kind == Kind::name && (before.text == "and" || before.text == "or" ||
                                         before.text == "not" || before.text == "return");
  }

  // a.b["c"] as "@a.b.c"; the cursor is at its first name, and afterwards behind it.
  std::string chain() {
    std::string path = "@" + tokens_[at_++].text;
    for (;;) {
      if (is(".") && is_kind(Kind::name, 1)) {
        path += "." + tokens_[at_ + 1].text;
        at_ += 2;
      } else if (is("[") && is_kind(Kind::text, 1) && is("]", 2)) {
        path += "." + tokens_[at_ + 1].text;
        at_ += 3;
      } else {
        return path;
      }
    }
  }

  // Notes that `path` gets the value that begins at the cursor, and which kind of value it is.
  // A value that is a variable and nothing else ("camera = top") leads to that variable's own
  // entries; one that goes on ("top or {}") is computed, and leads nowhere. The cursor stays where
  // it was.
  void keep(const std::string& path, int line, bool in_table) {
    Entry entry{path, line};
    const std::size_t start = at_;
    if (is_variable()) {
      std::string alias = chain();
      if (ends_value(in_table)) entry.alias = std::move(alias);
    } else if (is("{")) {
      entry.literal = true;
    }
    at_ = start;
    entries_.push_back(std::move(entry));
  }

  // In a statement a name right behind the value begins the next one; `and` and `or` continue it.
  bool ends_value(bool in_table) const {
    if (at_ >= tokens_.size() || is(",") || is(";") || is("}")) return true;
    return !in_table && is_kind(Kind::name) && !is("and") && !is("or");
  }

  // Items without a key count from 1, as Lua counts them; the paths are those of the config reader.
  void constructor(const std::string& path, int depth) {
    ++at_;
    if (depth > kMaxDepth) at_ = tokens_.size();
    int items = 0;
    while (at_ < tokens_.size() && !is("}")) {
      if (is(",") || is(";")) {
        ++at_;
        continue;
      }
      const int line = tokens_[at_].line;
      const std::string own = path + "." + key(items);
      keep(own, line, true);
      value(own, depth);
    }
    ++at_;
  }

  // The key of the next item; the cursor is then at its value.
  // A computed key, [i + 1], is noted as "[...]": it is found by no path, and its value is still
  // read through.
  std::string key(int& items) {
    if (is_kind(Kind::name) && is("=", 1)) {
      at_ += 2;
      return tokens_[at_ - 2].text;
    }
    if (!is("[")) return std::to_string(++items);
    const bool constant = (is_kind(Kind::text, 1) || is_kind(Kind::number, 1)) && is("]", 2);
    std::string name = constant ? tokens_[at_ + 1].text : "[...]";
    for (int open = 0; at_ < tokens_.size(); ++at_) {
      open += is("[") ? 1 : is("]") ? -1 : 0;
      if (open == 0) break;
    }
    ++at_;
    if (is("=")) ++at_;
    return name;
  }

  // An item's value, up to the comma behind it or the constructor's end.
  void value(const std::string& path, int depth) {
    int open = 0;  // ( and [
    while (at_ < tokens_.size()) {
      if (is("{")) {
        constructor(path, depth + 1);
        continue;
      }
      if (is("function")) {
        function(depth + 1);
        continue;
      }
      if (is("}") || (open == 0 && (is(",") || is(";")))) return;
      open += is("(") || is("[") ? 1 : is(")") || is("]") ? -1 : 0;
      ++at_;
    }
  }

  std::vector<LuaToken> tokens_;
  std::size_t at_ = 0;
  std::vector<Entry> entries_;
};

/// The entries of a text by their paths, through variables.
class Paths {
 public:
  explicit Paths(std::vector<Entry> entries) : entries_(std::move(entries)) {}

  /// The last of several is the one in effect. Null when there is none.
  /// Exact first. Then from the longest prefix to the shortest: where a table is a variable's, the
  /// rest of the path goes on in the variable.
  const Entry* find(const std::string& path, int depth = 0) const {
    const auto found = std::find_if(entries_.rbegin(), entries_.rend(),
                                    [&](const Entry& entry) { return entry.path == path; });
    if (found != entries_.rend()) return &*found;
    constexpr int kMaxAliases = 8;  // a = b and b = a would go on for ever
    if (depth == kMaxAliases) return nullptr;
    for (std::size_t dot = path.rfind('.'); dot != std::string::npos && dot > 0;
         dot = path.rfind('.', dot - 1)) {
      const Entry* const parent = exact_alias(path.substr(0, dot));
      if (parent == nullptr) continue;
      if (const Entry* const entry = find(parent->alias + path.substr(dot), depth + 1))
        return entry;
    }
    return nullptr;
  }

  /// A key of that name in a table that is not the returned one.
  /// For tables that a function or a loop makes: the first place that sets such a key is the best
  /// guess.
  const Entry* find_elsewhere(const std::string& name) const {
    const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) {
      return !entry.path.starts_with(kReturned) && entry.path.ends_with("." + name);
    });
    return found == entries_.end() ? nullptr : &*found;
  }

 private:
  const Entry* exact_alias(const std::string& path) const {
    const auto found = std::find_if(entries_.rbegin(), entries_.rend(), [&](const Entry& entry) {
      return entry.path == path && !entry.alias.empty();
    });
    return found == entries_.rend() ? nullptr : &*found;
  }

  std::vector<Entry> entries_;
};

/// Whether the entry's table stands in the text as it is, perhaps under a variable's name.
bool is_literal(const Paths& paths, const Entry& entry) {
  if (entry.literal) return true;
  const Entry* const variable = entry.alias.empty() ? nullptr : paths.find(entry.alias);
  return variable != nullptr && variable->literal;
}

}  // namespace

// Four answers, each less exact than the one before: the key itself; a key of that name elsewhere,
// if its table is computed; the line of its table; nothing.
int find_line(std::string_view text, std::string_view dotted_key) {
  const Paths paths(Reader(text).entries());
  std::string path = kReturned + "." + std::string(dotted_key);
  if (const Entry* const entry = paths.find(path)) return entry->line;
  const std::string last = path.substr(path.rfind('.') + 1);
  const Entry* parent = nullptr;
  while (parent == nullptr && path.rfind('.') != std::string::npos) {
    path.resize(path.rfind('.'));
    parent = paths.find(path);
  }
  if (parent == nullptr || !is_literal(paths, *parent))
    if (const Entry* const entry = paths.find_elsewhere(last)) return entry->line;
  return parent != nullptr && path != kReturned ? parent->line : 0;
}

}  // namespace vitreo
