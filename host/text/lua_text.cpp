// SPDX-License-Identifier: Apache-2.0
#include "host/text/lua_text.h"

#include <fmt/format.h>

namespace vitreo {

// Three digits always: a digit may follow.
std::string lua_quoted(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\')
      quoted += std::string("\\") + c;
    else if (c >= ' ' && c <= '~')
      quoted += c;
    else
      quoted += fmt::format("\\{:03}", static_cast<unsigned char>(c));
  }
  return quoted + "\"";
}

}  // namespace vitreo
