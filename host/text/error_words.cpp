// SPDX-License-Identifier: Apache-2.0
#include "host/text/error_words.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <array>
#include <string_view>

namespace vitreo {
namespace {

using Json = nlohmann::json;

// The library's numbers of errors (its documentation, "Exceptions").
constexpr int kWrongType = 302;
constexpr int kNotUtf8 = 316;
constexpr int kNoSuchIndex = 401;
constexpr int kNoSuchKey = 403;

/// The library's name of a kind as people call it.
std::string kind_name(std::string_view name) {
  struct Name {
    std::string_view of_library, ours;
  };
  constexpr std::array kNames{Name{"string", "a text"},           Name{"number", "a number"},
                              Name{"boolean", "true or false"},   Name{"array", "a list"},
                              Name{"object", "a table of names"}, Name{"null", "nothing"},
                              Name{"discarded", "no JSON"}};
  for (const Name& one : kNames)
    if (name == one.of_library) return std::string(one.ours);
  return std::string(name);
}

/// Of "... `from`WORD`to`...": the word, or nothing where the text is another one.
std::string_view between(std::string_view text, std::string_view from, std::string_view to) {
  const std::size_t at = text.find(from);
  if (at == std::string_view::npos) return {};
  text.remove_prefix(at + from.size());
  return text.substr(0, to.empty() ? text.npos : text.find(to));
}

std::string type_words(const Json::type_error& error) {
  if (error.id == kNotUtf8) return "a text is not UTF-8";
  const std::string_view said = error.what();
  const std::string_view wanted = between(said, "type must be ", ", but");
  const std::string_view got = between(said, "but is ", "");
  if (error.id != kWrongType || wanted.empty()) return "a value is of the wrong kind";
  return fmt::format("a value is of the wrong kind: wants {}, got {}", kind_name(wanted),
                     kind_name(got));
}

std::string range_words(const Json::out_of_range& error) {
  const std::string_view said = error.what();
  if (error.id == kNoSuchKey) return fmt::format("{}: is missing", between(said, "key '", "' not"));
  if (error.id == kNoSuchIndex) return "a list is too short";
  return "a number is too large";
}

}  // namespace

std::string error_words(const std::exception& error) {
  if (const auto* const parse = dynamic_cast<const Json::parse_error*>(&error))
    return fmt::format("is no JSON from byte {} on", parse->byte);
  if (const auto* const type = dynamic_cast<const Json::type_error*>(&error))
    return type_words(*type);
  if (const auto* const range = dynamic_cast<const Json::out_of_range*>(&error))
    return range_words(*range);
  if (dynamic_cast<const Json::exception*>(&error) != nullptr) return "the JSON cannot be used";
  return error.what();
}

}  // namespace vitreo
