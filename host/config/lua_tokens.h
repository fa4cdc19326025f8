// Lexer of Lua 5.4: the tokens of a text, each with its line as Lua counts it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

/// Keywords are names. Symbols are one or more characters: ==, ~=, .. and the like are one token.
struct LuaToken {
  enum class Kind { name, text, number, symbol };
  Kind kind = Kind::symbol;
  std::string text;  ///< of a string what stands in it, escapes replaced
  int line = 1;      ///< on which it begins, from 1
};

/// Comments are left out. Never throws: what is no Lua gives some tokens.
std::vector<LuaToken> lua_tokens(std::string_view text);

}  // namespace vitreo
