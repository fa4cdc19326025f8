// A recursive reader over indented lines; every error carries its line.
// SPDX-License-Identifier: Apache-2.0
#include "control/yaml_text.h"

#include <algorithm>
#include <cstddef>
#include <stdexcept>
#include <utility>

namespace vitreo::control {
namespace {

constexpr int kMaxDepth = 32;  // a calibration needs four; a hostile file must not end the stack
constexpr std::size_t kMaxBytes = std::size_t{4} << 20;  // a calibration has 10 to 30 kB

[[noreturn]] void fail(int line, const std::string& what) {
  throw std::invalid_argument("line " + std::to_string(line) + ": " + what);
}

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// The end of what stands before a comment; a # counts only at the start or after a blank, and not
// within quotes.
std::size_t comment_start(std::string_view line) {
  char quote = 0;
  for (std::size_t k = 0; k < line.size(); ++k) {
    const char c = line[k];
    if (quote != 0) {
      if (c == quote) quote = 0;
    } else if ((c == '"' || c == '\'') &&
               (k == 0 || std::string_view(" \t[,").find(line[k - 1]) != std::string_view::npos)) {
      quote = c;
    } else if (c == '#' && (k == 0 || line[k - 1] == ' ' || line[k - 1] == '\t')) {
      return k;
    }
  }
  return line.size();
}

struct Line {
  int number;
  std::size_t indent;
  std::string_view text;
};

std::vector<Line> lines_of(std::string_view text) {
  std::vector<Line> lines;
  int number = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    std::string_view line = text.substr(begin, end - begin);
    begin = end + 1;
    ++number;
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    if (line.find('\0') != std::string_view::npos) fail(number, "a zero byte: not a text file");
    line = line.substr(0, comment_start(line));
    const std::string_view content = trimmed(line);
    if (content.empty() || content == "..." || content.front() == '%') continue;
    if (content == "---") {
      if (!lines.empty()) fail(number, "a second document");
      continue;
    }
    const std::size_t indent = line.find_first_not_of(' ');
    if (line[indent] == '\t') fail(number, "a tab in the indentation");
    lines.push_back({number, indent, content});
  }
  return lines;
}

bool is_item(std::string_view text) { return text == "-" || text.substr(0, 2) == "- "; }

// Where the colon after a key stands, or npos.
std::size_t key_end(std::string_view text) {
  if (text.front() == '[' || text.front() == '{') return std::string_view::npos;
  std::size_t begin = 0;
  if (text.front() == '"' || text.front() == '\'') {
    const std::size_t closing = text.find(text.front(), 1);
    begin = closing == std::string_view::npos ? text.size()
                                              : text.find_first_not_of(" \t", closing + 1);
    if (begin >= text.size() || text[begin] != ':') return std::string_view::npos;
  }
  for (std::size_t k = begin; k < text.size(); ++k) {
    if (text[k] == ':' && (k + 1 == text.size() || text[k + 1] == ' ' || text[k + 1] == '\t'))
      return k;
  }
  return std::string_view::npos;
}

YamlNode scalar_node(int line, std::string_view text) {
  YamlNode node;
  node.line = line;
  if (text == "~" || text == "null" || text.empty()) return node;
  node.kind = YamlNode::Kind::scalar;
  const char first = text.front();
  if (first == '"' || first == '\'') {
    if (text.size() < 2 || text.back() != first) fail(line, "a quote that does not end");
    node.scalar = text.substr(1, text.size() - 2);
  } else if (std::string_view("&*!|>{}%@`").find(first) != std::string_view::npos) {
    fail(line, "begins with '" + std::string(1, first) + "', which is not supported here");
  } else {
    node.scalar = text;
  }
  return node;
}

// A key may stand in quotes.
std::string key_of(std::string_view text) {
  if (text.size() >= 2 && (text.front() == '"' || text.front() == '\'') &&
      text.back() == text.front())
    text = text.substr(1, text.size() - 2);
  return std::string(text);
}

class Reader {
 public:
  explicit Reader(std::string_view text) : lines_(lines_of(text)) {}

  YamlNode document() {
    if (lines_.empty()) return {};
    YamlNode node = block(lines_.front().indent, 0);
    if (!done()) fail(here().number, "indentation that fits nothing above it");
    return node;
  }

 private:
  bool done() const { return next_ == lines_.size(); }
  Line& here() { return lines_[next_]; }

  YamlNode block(std::size_t indent, int depth) {
    if (depth > kMaxDepth) fail(here().number, "nested too deeply");
    if (is_item(here().text)) return sequence(indent, depth);
    if (key_end(here().text) != std::string_view::npos) return mapping(indent, depth);
    return value(here().text, depth);
  }

  YamlNode sequence(std::size_t indent, int depth) {
    YamlNode node;
    node.kind = YamlNode::Kind::sequence;
    node.line = here().number;
    while (!done() && here().indent == indent && is_item(here().text)) {
      Line& line = here();
      const std::string_view rest = trimmed(line.text.substr(1));
      if (rest.empty()) {
        node.items.push_back(below(indent, false, depth));
      } else if (is_item(rest) || key_end(rest) != std::string_view::npos) {
        // A block that begins on the line of its own dash stands where its first character does.
        line.indent += static_cast<std::size_t>(rest.data() - line.text.data());
        line.text = rest;
        node.items.push_back(block(line.indent, depth + 1));
      } else {
        node.items.push_back(value(rest, depth));
      }
    }
    return node;
  }

  YamlNode mapping(std::size_t indent, int depth) {
    YamlNode node;
    node.kind = YamlNode::Kind::mapping;
    node.line = here().number;
    while (!done() && here().indent == indent && !is_item(here().text)) {
      const Line line = here();
      const std::size_t colon = key_end(line.text);
      if (colon == std::string_view::npos) fail(line.number, "neither 'key: value' nor '- item'");
      std::string key = key_of(trimmed(line.text.substr(0, colon)));
      if (key.empty()) fail(line.number, "a key without a name");
      if (node.find(key)) fail(line.number, "'" + key + "' is given twice");
      const std::string_view rest = trimmed(line.text.substr(colon + 1));
      YamlNode child = rest.empty() ? below(indent, true, depth) : value(rest, depth);
      node.members.push_back({std::move(key), std::move(child)});
    }
    return node;
  }

  // What stands under a key or a dash with nothing beside it. A sequence may stand as far left as
  // its key.
  YamlNode below(std::size_t indent, bool under_key, int depth) {
    YamlNode nothing;
    nothing.line = here().number;
    ++next_;
    if (done()) return nothing;
    const bool deeper = here().indent > indent;
    if (deeper || (under_key && here().indent == indent && is_item(here().text)))
      return block(here().indent, depth + 1);
    return nothing;
  }

  // A scalar, or a list or a mapping in brackets, which may run over several lines.
  YamlNode value(std::string_view text, int depth) {
    const int line = here().number;
    ++next_;
    if (text.front() != '[' && text.front() != '{') return scalar_node(line, text);
    std::string all(text);
    while (flow_open(all)) {
      if (done()) unended(line, text.front());
      all += ' ';
      all += here().text;
      ++next_;
    }
    std::size_t at = 0;
    YamlNode node = flow(all, at, line, depth + 1);
    if (at != all.size())
      fail(line, std::string("more after '") + (text.front() == '[' ? "]'" : "}'"));
    return node;
  }

  [[noreturn]] static void unended(int line, char bracket) {
    fail(line, std::string("a '") + bracket + "' that does not end");
  }

  static bool flow_open(std::string_view text) {
    int open = 0;
    for (const char c : text) open += c == '[' || c == '{' ? 1 : c == ']' || c == '}' ? -1 : 0;
    return open > 0;
  }

  static void skip_blanks(std::string_view text, std::size_t& at) {
    at = std::min(text.find_first_not_of(" \t", at), text.size());
  }

  // What stands between brackets and commas; `at` is at its first character.
  static YamlNode flow(std::string_view text, std::size_t& at, int line, int depth) {
    if (depth > kMaxDepth) fail(line, "nested too deeply");
    if (text[at] == '[' || text[at] == '{') return collection(text, at, line, depth);
    const std::size_t end = std::min(text.find_first_of("[]{},", at), text.size());
    const std::string_view item = trimmed(text.substr(at, end - at));
    if (item.empty()) fail(line, "an empty place in a list");
    at = end;
    return scalar_node(line, item);
  }

  // The key of a member, up to its colon and the blanks behind it.
  static std::string flow_key(std::string_view text, std::size_t& at, int line) {
    const std::size_t colon = std::min(text.find_first_of(":[]{},", at), text.size());
    if (colon == text.size() || text[colon] != ':')
      fail(line, "'key: value' expected between { and }");
    std::string key = key_of(trimmed(text.substr(at, colon - at)));
    if (key.empty()) fail(line, "a key without a name");
    at = colon + 1;
    skip_blanks(text, at);
    return key;
  }

  static YamlNode collection(std::string_view text, std::size_t& at, int line, int depth) {
    const char begin = text[at++], end = begin == '[' ? ']' : '}';
    YamlNode node;
    node.kind = begin == '[' ? YamlNode::Kind::sequence : YamlNode::Kind::mapping;
    node.line = line;
    for (;;) {
      skip_blanks(text, at);
      if (at == text.size()) unended(line, begin);
      if (text[at] == end) break;
      if (begin == '[') {
        node.items.push_back(flow(text, at, line, depth + 1));
      } else {
        std::string key = flow_key(text, at, line);
        if (node.find(key)) fail(line, "'" + key + "' is given twice");
        if (at == text.size()) unended(line, begin);
        YamlNode nothing;
        nothing.line = line;
        const bool empty = text[at] == ',' || text[at] == end;
        node.members.push_back({std::move(key), empty ? nothing : flow(text, at, line, depth + 1)});
      }
      skip_blanks(text, at);
      if (at < text.size() && text[at] == ',') {
        ++at;
      } else if (at == text.size() || text[at] != end) {
        fail(line, std::string("',' or '") + end + "' expected in a " +
                       (begin == '[' ? "list" : "mapping"));
      }
    }
    ++at;
    return node;
  }

  std::vector<Line> lines_;
  std::size_t next_ = 0;
};

}  // namespace

const YamlNode* YamlNode::find(std::string_view key) const {
  for (const auto& [name, node] : members) {
    if (name == key) return &node;
  }
  return nullptr;
}

YamlNode parse_yaml(std::string_view text) {
  if (text.size() > kMaxBytes) throw std::invalid_argument("line 1: the file is larger than 4 MiB");
  if (text.substr(0, 3) == "\xef\xbb\xbf") text.remove_prefix(3);  // an editor's byte order mark
  return Reader(text).document();
}

}  // namespace vitreo::control
