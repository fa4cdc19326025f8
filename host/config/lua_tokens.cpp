// SPDX-License-Identifier: Apache-2.0
#include "host/config/lua_tokens.h"

#include <array>
#include <charconv>
#include <optional>

namespace vitreo {
namespace {

using Kind = LuaToken::Kind;

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_name(char c) {
  return c == '_' || is_digit(c) || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}
bool is_line_end(char c) { return c == '\n' || c == '\r'; }

/// Section 3.1 of the Lua 5.4 manual.
class Lexer {
 public:
  explicit Lexer(std::string_view text) : text_(text) {}

  // Keeps going through what is no Lua: the caller looks for a line in a file that may be broken,
  // and for whose errors Lua itself speaks.
  std::vector<LuaToken> tokens() {
    while (!done()) step();
    return std::move(tokens_);
  }

 private:
  bool done() const { return at_ >= text_.size(); }
  char peek(std::size_t ahead = 0) const {
    return at_ + ahead < text_.size() ? text_[at_ + ahead] : '\0';
  }

  // Lua counts \n, \r, \r\n and \n\r as one line end each.
  void next_line() {
    const char first = peek();
    ++at_;
    if (!done() && is_line_end(peek()) && peek() != first) ++at_;
    ++line_;
  }

  // One token, blank, line end or comment. At least one character is taken each time, so that any
  // text comes to an end.
  void step() {
    const char c = peek();
    if (is_line_end(c)) return next_line();
    if (text_.substr(at_, 2) == "--") return skip_comment();
    if (is_digit(c) || (c == '.' && is_digit(peek(1)))) return read_number();
    if (is_name(c)) return read_name();
    if (c == '"' || c == '\'') return read_quoted();
    if (c == '[') {
      const int line = line_;
      if (auto text = long_bracket()) return keep(Kind::text, std::move(*text), line);
    }
    if (c == ' ' || c == '\t' || c == '\v' || c == '\f') {
      ++at_;
      return;
    }
    read_symbol();
  }

  void keep(Kind kind, std::string text, int line) {
    tokens_.push_back({kind, std::move(text), line});
  }

  // A long bracket that begins at once makes the comment long: --[[ ... ]].
  void skip_comment() {
    at_ += 2;
    if (peek() == '[' && long_bracket()) return;
    while (!done() && !is_line_end(peek())) ++at_;
  }

  // [[ ... ]] or [==[ ... ]==], if one begins here; a line end that follows the opening at once is
  // not part of it.
  std::optional<std::string> long_bracket() {
    std::size_t level = 0;
    while (peek(1 + level) == '=') ++level;
    if (peek(1 + level) != '[') return std::nullopt;
    at_ += 2 + level;
    if (!done() && is_line_end(peek())) next_line();
    const std::string closing = "]" + std::string(level, '=') + "]";
    std::string content;
    while (!done()) {
      if (text_.substr(at_, closing.size()) == closing) {
        at_ += closing.size();
        break;
      }
      content += is_line_end(peek()) ? '\n' : peek();
      if (is_line_end(peek())) {
        next_line();
      } else {
        ++at_;
      }
    }
    return content;
  }

  void read_number() {
    const std::size_t start = at_;
    const bool hexadecimal = peek() == '0' && (peek(1) == 'x' || peek(1) == 'X');
    const std::string_view exponents = hexadecimal ? "pP" : "eE";
    while (is_name(peek()) || peek() == '.') {
      const bool exponent = exponents.find(peek()) != std::string_view::npos;
      // 1..2 is two numbers and ".." only with blanks; Lua refuses it, and so it does not matter.
      ++at_;
      if (exponent && (peek() == '+' || peek() == '-')) ++at_;
    }
    keep(Kind::number, std::string(text_.substr(start, at_ - start)), line_);
  }

  void read_name() {
    const std::size_t start = at_;
    while (is_name(peek())) ++at_;
    keep(Kind::name, std::string(text_.substr(start, at_ - start)), line_);
  }

  // A string without its end stops at the line's, so that a missing quote does not swallow the rest
  // of the file.
  void read_quoted() {
    const char quote = peek();
    const int line = line_;
    std::string content;
    ++at_;
    while (!done() && peek() != quote && !is_line_end(peek())) {
      if (peek() == '\\') {
        read_escape(content);
      } else {
        content += peek();
        ++at_;
      }
    }
    if (peek() == quote) ++at_;
    keep(Kind::text, std::move(content), line);
  }

  void read_escape(std::string& content) {
    ++at_;
    const char c = peek();
    if (done()) return;
    if (is_line_end(c)) {
      content += '\n';
      return next_line();
    }
    if (is_digit(c)) return read_code(content, 3, 10);
    ++at_;
    if (c == 'x') return read_code(content, 2, 16);
    if (c == 'u' && peek() == '{') {
      ++at_;
      read_code(content, 8, 16);
      if (peek() == '}') ++at_;
    } else if (c == 'z') {
      skip_blanks();
    } else {
      constexpr std::string_view kNames = "abfnrtv";
      constexpr std::string_view kCodes = "\a\b\f\n\r\t\v";
      const std::size_t known = kNames.find(c);
      content += known == std::string_view::npos ? c : kCodes[known];
    }
  }

  // A code of at most `most` digits. Above 127 it is one byte: keys of a rig file are ASCII.
  void read_code(std::string& content, std::size_t most, int base) {
    const std::string_view digits = text_.substr(at_, most);
    unsigned int code = 0;
    const auto [end, error] =
        std::from_chars(digits.data(), digits.data() + digits.size(), code, base);
    at_ += static_cast<std::size_t>(end - digits.data());
    if (error == std::errc()) content += static_cast<char>(code & 0xFF);
  }

  void skip_blanks() {
    while (!done() && (is_line_end(peek()) || peek() == ' ' || peek() == '\t')) {
      if (is_line_end(peek())) {
        next_line();
      } else {
        ++at_;
      }
    }
  }

  void read_symbol() {
    // Longer ones first, where one begins like another.
    constexpr std::array<std::string_view, 10> kLong = {
        "...", "..", "==", "~=", "<=", ">=", "//", "::", "<<", ">>"};
    for (const std::string_view symbol : kLong) {
      if (text_.substr(at_, symbol.size()) != symbol) continue;
      keep(Kind::symbol, std::string(symbol), line_);
      at_ += symbol.size();
      return;
    }
    keep(Kind::symbol, std::string(1, peek()), line_);
    ++at_;
  }

  std::string_view text_;
  std::size_t at_ = 0;
  int line_ = 1;
  std::vector<LuaToken> tokens_;
};

}  // namespace

std::vector<LuaToken> lua_tokens(std::string_view text) { return Lexer(text).tokens(); }

}  // namespace vitreo
