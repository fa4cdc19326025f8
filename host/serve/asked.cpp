// SPDX-License-Identifier: Apache-2.0
#include "host/serve/asked.h"

#include "host/config/config.h"

#include <algorithm>
#include <charconv>

namespace vitreo::serve {

std::string Asked::value_or(const std::string& name, const std::string& otherwise) const {
  const auto found = query.find(name);
  return found == query.end() ? otherwise : found->second;
}

std::size_t Asked::count_or(const std::string& name, const std::string& otherwise) const {
  return static_cast<std::size_t>(whole(name, value_or(name, otherwise)));
}

// By hand, and strictly: a broken code is refused, not passed on as it stands.
std::string decoded(std::string_view text) {
  std::string plain;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '+') {
      plain += ' ';
    } else if (text[i] == '%') {
      int code = 0;
      const auto end = text.data() + std::min(i + 3, text.size());
      const auto read = std::from_chars(text.data() + i + 1, end, code, 16);
      if (read.ptr != text.data() + i + 3) throw ConfigError("the address: has a broken % code");
      plain += static_cast<char>(code);
      i += 2;
    } else {
      plain += text[i];
    }
  }
  return plain;
}

// Empty parts are left out: "//" and a slash at the end name nothing.
std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::size_t begin = 0;
  while (begin <= text.size()) {
    const std::size_t end = std::min(text.find(separator, begin), text.size());
    if (end > begin) parts.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

// from_chars: no sign, no blanks, no locale, and all of the text or nothing.
std::int64_t whole(const std::string& name, const std::string& text) {
  std::int64_t number = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), number);
  if (read.ec != std::errc() || read.ptr != text.data() + text.size() || number < 0)
    throw ConfigError(name + ": wants a whole number; got " + text.substr(0, 40));
  return number;
}

// Split before decoding: a %26 in a value is no separator.
std::map<std::string, std::string> query_of(const std::string& text) {
  std::map<std::string, std::string> query;
  for (const std::string& pair : split(text, '&')) {
    const std::size_t equals = pair.find('=');
    query[decoded(pair.substr(0, equals))] =
        equals == std::string::npos ? "" : decoded(pair.substr(equals + 1));
  }
  return query;
}

}  // namespace vitreo::serve
