// SPDX-License-Identifier: Apache-2.0
#include "host/config/config_lines.h"

#include <algorithm>
#include <vector>

namespace vitreo {
namespace {

/// An assignment `name =` or `["name"] =`, and how many tables it stands in.
struct Assignment {
  std::string name;
  std::size_t position;
  int depth;
};

bool is_word(char c) {
  return c == '_' || (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

/// Just enough of Lua's grammar to tell keys from comments, strings and values.
class Scanner {
 public:
  explicit Scanner(std::string_view text) : text_(text) {}

  std::vector<Assignment> assignments() {
    while (at_ < text_.size()) step();
    return std::move(found_);
  }

 private:
  void step() {
    const char c = text_[at_];
    if (text_.substr(at_, 2) == "--") return skip_comment();
    if (c == '"' || c == '\'') return read_string();
    if (is_word(c)) return read_word();
    if (c == '{') ++depth_;
    if (c == '}') --depth_;
    if (c == '=' && peek(1) != '=' && !is_comparison()) keep();
    if (c != ' ' && c != '\t' && c != '\n' && c != '\r' && c != '[' && c != ']') last_.clear();
    ++at_;
  }

  char peek(std::size_t ahead) const {
    return at_ + ahead < text_.size() ? text_[at_ + ahead] : '\0';
  }
  bool is_comparison() const {
    return at_ > 0 && std::string_view("=<>~").find(text_[at_ - 1]) != std::string_view::npos;
  }

  void keep() {
    if (!last_.empty()) found_.push_back({last_, last_at_, depth_});
  }

  void skip_comment() {
    const bool is_long = text_.substr(at_, 4) == "--[[";
    const std::size_t end = is_long ? text_.find("]]", at_) : text_.find('\n', at_);
    at_ = end == std::string_view::npos ? text_.size() : end + (is_long ? 2 : 0);
  }

  void read_string() {
    const char quote = text_[at_];
    const std::size_t start = at_++;
    while (at_ < text_.size() && text_[at_] != quote && text_[at_] != '\n')
      at_ += text_[at_] == '\\' ? 2 : 1;
    at_ = std::min(at_ + 1, text_.size());
    last_ = at_ > start + 1 ? text_.substr(start + 1, at_ - start - 2) : std::string_view();
    last_at_ = start;
  }

  void read_word() {
    const std::size_t start = at_;
    while (at_ < text_.size() && is_word(text_[at_])) ++at_;
    last_ = text_.substr(start, at_ - start);
    last_at_ = start;
  }

  std::string_view text_;
  std::size_t at_ = 0, last_at_ = 0;
  int depth_ = 0;
  std::string last_;  // the word or string just read: a key, if "=" follows
  std::vector<Assignment> found_;
};

int line_of(std::string_view text, std::size_t position) {
  return 1 + static_cast<int>(std::count(
                 text.begin(), text.begin() + static_cast<std::ptrdiff_t>(position), '\n'));
}

std::vector<std::string> parts_of(std::string_view dotted_key) {
  std::vector<std::string> parts(1);
  for (char c : dotted_key) {
    if (c == '.') {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

}  // namespace

int find_line(std::string_view text, std::string_view dotted_key) {
  const std::vector<Assignment> all = Scanner(text).assignments();
  const std::vector<std::string> parts = parts_of(dotted_key);
  const Assignment* parent = nullptr;
  for (const std::string& part : parts) {
    const Assignment* match = nullptr;
    for (const Assignment& candidate : all) {
      if (parent && candidate.position <= parent->position) continue;
      if (parent && candidate.depth <= parent->depth) break;  // the parent's table has ended
      if (candidate.name == part && (!parent || candidate.depth == parent->depth + 1)) {
        match = &candidate;
        break;
      }
    }
    if (!match) break;
    parent = match;
    if (&part == &parts.back()) return line_of(text, match->position);
  }
  const auto loose = std::find_if(all.begin(), all.end(),
                                  [&](const auto& one) { return one.name == parts.back(); });
  if (loose != all.end()) return line_of(text, loose->position);
  return parent ? line_of(text, parent->position) : 0;
}

}  // namespace vitreo
