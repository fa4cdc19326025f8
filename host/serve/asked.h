// Asked: a request to the workbench taken apart, as its routes read it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/view/web_request.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::serve {

struct Asked {
  const view::WebRequest& request;
  std::map<std::string, std::string> query{};  // decoded
  std::vector<std::string> names{};            // what stands for {id}, {name}; decoded
  nlohmann::json body{};                       // null where there is none

  std::string value_or(const std::string& name, const std::string& otherwise) const;
  /// A count in the query. Throws ConfigError for what is none.
  std::size_t count_or(const std::string& name, const std::string& otherwise) const;
};

/// %41 and "+" (application/x-www-form-urlencoded). Throws ConfigError for half a code.
std::string decoded(std::string_view text);
/// "a=1&b=2", decoded.
std::map<std::string, std::string> query_of(const std::string& text);
/// Without the empty ones.
std::vector<std::string> split(const std::string& text, char separator);
/// Not negative. Throws ConfigError with `name` in front.
std::int64_t whole(const std::string& name, const std::string& text);

}  // namespace vitreo::serve
