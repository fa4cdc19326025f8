// SPDX-License-Identifier: Apache-2.0
#include "host/config/lua_entries.h"

#include "host/config/lua_tokens.h"

#include <map>
#include <set>
#include <utility>

namespace vitreo {
namespace {

using TokenKind = LuaToken::Kind;

constexpr int kMaxDepth = 100;  // of tables and functions: a hostile text must not end the stack

bool is_keyword(const std::string& name) {
  static const std::set<std::string> kKeywords{
      "and",      "break",  "do",   "else", "elseif", "end",  "false", "for",
      "function", "goto",   "if",   "in",   "local",  "nil",  "not",   "or",
      "repeat",   "return", "then", "true", "until",  "while"};
  return kKeywords.contains(name);
}

/// Reads as much of Lua's grammar as tells where a key gets its value: table constructors, chains
/// a.b["c"], assignments, where the blocks of functions end, and what they return.
class EntryReader {
 public:
  explicit EntryReader(std::string_view text) : tokens_(lua_tokens(text)) {}

  std::vector<LuaEntry> entries() {
    while (at_ < tokens_.size()) statements("", 0);
    return std::move(entries_);
  }

 private:
  // Tokens of strings never match, so that "end" in a text ends no block.
  bool is(std::string_view text, std::size_t ahead = 0) const {
    return at_ + ahead < tokens_.size() && tokens_[at_ + ahead].kind != TokenKind::text &&
           tokens_[at_ + ahead].text == text;
  }
  bool is_kind(TokenKind kind, std::size_t ahead = 0) const {
    return at_ + ahead < tokens_.size() && tokens_[at_ + ahead].kind == kind;
  }
  bool is_variable(std::size_t ahead = 0) const {
    return is_kind(TokenKind::name, ahead) && !is_keyword(tokens_[at_ + ahead].text);
  }

  // Statements up to the `end` of the function whose body this is, or to the text's end.
  // `returned` is the path of what that function returns, "" outside of any. `target` is the path
  // under which a table constructor's keys are noted; "@" is that of a table without a name, such
  // as a call's argument.
  void statements(const std::string& returned, int depth) {
    std::string target;  // of the assignment that goes on
    int blocks = 0;
    while (at_ < tokens_.size()) {
      if (is("{")) {
        constructor(target, depth + 1);
      } else if (is("function")) {
        function(target, depth + 1);
      } else if (is("end") || is("until")) {
        ++at_;
        if (blocks-- == 0 && !returned.empty()) return;
      } else if (is("do") || is("if") || is("repeat")) {  // `while` and `for` have their `do`
        ++blocks;
        ++at_;
      } else if (is("local") || is("for")) {
        ++at_;
        declare();
      } else if (is("return")) {
        target = returned.empty() ? kReturnedRoot : returned;
        const int line = tokens_[at_++].line;
        keep(target, line, false);
      } else if (is_variable()) {
        variable(target);
      } else {
        ++at_;
      }
    }
  }

  /// The names at the cursor, which stays, belong to the function whose body is read: those of two
  /// functions are not the same variable. Blocks within a function are not told apart.
  void declare() {
    if (scopes_.empty()) return;
    std::size_t ahead = is("function") ? 1 : 0;
    for (; is_variable(ahead); ++ahead) {
      const std::string& name = tokens_[at_ + ahead].text;
      scopes_.back()[name] = "@" + name + "#" + std::to_string(scopes_made_);
      if (is("<", ahead + 1)) ahead += 3;  // <const>, <close>
      if (!is(",", ++ahead)) return;
    }
  }

  std::string root_of(const std::string& name) const {
    for (auto scope = scopes_.rbegin(); scope != scopes_.rend(); ++scope)
      if (const auto found = scope->find(name); found != scope->end()) return found->second;
    return "@" + name;
  }

  // From the word `function` to the `end` of its body; `path` is that of a value without a name of
  // its own, such as what is assigned.
  void function(std::string path, int depth) {
    ++at_;
    if (is_variable()) path = chain();
    // The rest of the text is given up: its keys have no line.
    if (depth > kMaxDepth) {
      at_ = tokens_.size();
      return;
    }
    scopes_.emplace_back();
    ++scopes_made_;
    if (is("(")) {
      ++at_;
      declare();
    }
    statements((path.empty() ? "@" : path) + kReturns, depth);
    scopes_.pop_back();
  }

  // A chain in a statement: what is assigned, or a part of an expression.
  void variable(std::string& target) {
    const bool begins = at_ == 0 || !continues_expression();
    const std::string path = chain();
    const int line = tokens_[at_ - 1].line;
    while (is("<") && is_kind(TokenKind::name, 1) && is(">", 2)) at_ += 3;  // <const>, <close>
    if (is("=")) {
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
    if (before.kind == TokenKind::symbol)
      return before.text != ")" && before.text != "]" && before.text != "}" && before.text != ";";
    return before.kind == TokenKind::name && (before.text == "and" || before.text == "or" ||
                                              before.text == "not" || before.text == "return");
  }

  // a.b["c"] as "@a.b.c", a[i] as "@a.[]"; the cursor is at its first name, and afterwards behind
  // it.
  std::string chain() {
    std::string path = root_of(tokens_[at_++].text);
    for (;;) {
      if (is(".") && is_kind(TokenKind::name, 1)) {
        path += "." + tokens_[at_ + 1].text;
        at_ += 2;
      } else if (is("[")) {
        path += "." + bracketed_key();
      } else {
        return path;
      }
    }
  }

  // The cursor is at [, and afterwards behind its ].
  std::string bracketed_key() {
    const bool constant =
        (is_kind(TokenKind::text, 1) || is_kind(TokenKind::number, 1)) && is("]", 2);
    const std::string key = constant ? tokens_[at_ + 1].text : kComputedKey;
    skip("[", "]");
    return key;
  }

  // From the opening at the cursor to behind its closing.
  void skip(std::string_view opening, std::string_view closing) {
    int open = 0;
    for (; at_ < tokens_.size(); ++at_) {
      open += is(opening) ? 1 : is(closing) ? -1 : 0;
      if (open == 0) break;
    }
    ++at_;
  }

  // Notes that `path` gets the value that begins at the cursor, and which kind of value it is.
  // A value that is a variable and nothing else ("camera = top") leads to that variable's own
  // entries, a call ("camera = bench(2)") to those of what the function returns; one that goes on
  // ("top or {}") is computed, and leads nowhere. The cursor stays where it was.
  void keep(const std::string& path, int line, bool in_table) {
    LuaEntry entry{path, line};
    const std::size_t start = at_;
    if (is_variable()) {
      std::string alias = chain();
      if (is("(") || is("{") || is_kind(TokenKind::text)) {
        if (is("("))
          skip("(", ")");
        else if (is("{"))
          skip("{", "}");
        else
          ++at_;
        alias += kReturns;
      }
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
    return !in_table && is_kind(TokenKind::name) && !is("and") && !is("or");
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
  std::string key(int& items) {
    if (is_kind(TokenKind::name) && is("=", 1)) {
      at_ += 2;
      return tokens_[at_ - 2].text;
    }
    if (!is("[")) return std::to_string(++items);
    const std::string name = bracketed_key();
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
        function(path, depth + 1);
        continue;
      }
      if (is("}") || (open == 0 && (is(",") || is(";")))) return;
      open += is("(") || is("[") ? 1 : is(")") || is("]") ? -1 : 0;
      ++at_;
    }
  }

  std::vector<LuaToken> tokens_;
  std::size_t at_ = 0;
  std::vector<LuaEntry> entries_;
  std::vector<std::map<std::string, std::string>>
      scopes_;  // of functions: the roots of their names
  int scopes_made_ = 0;
};

}  // namespace

std::vector<LuaEntry> lua_entries(std::string_view text) { return EntryReader(text).entries(); }

}  // namespace vitreo
