// The rules are those of lstrlib.c of Lua 5.4 (R. Ierusalimschy et al., MIT licence), which the
// test compares it with.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/pattern.h"

#include <algorithm>
#include <cctype>
#include <string>

namespace vitreo::scripted {
namespace {

constexpr std::size_t kMostCaptures = 32;
// As MAXCCALLS of lstrlib.c: a pattern recurses by item, and the stack is the host's.
constexpr int kMostDepth = 200;
constexpr char kEscape = '%';
constexpr std::size_t kNone = static_cast<std::size_t>(-1);

int byte_of(char c) { return static_cast<unsigned char>(c); }

bool in_class(char c, char letter) {
  const int code = byte_of(c);
  const auto holds = [&]() -> bool {
    switch (std::tolower(byte_of(letter))) {
      case 'a':
        return std::isalpha(code) != 0;
      case 'c':
        return std::iscntrl(code) != 0;
      case 'd':
        return std::isdigit(code) != 0;
      case 'g':
        return std::isgraph(code) != 0;
      case 'l':
        return std::islower(code) != 0;
      case 'p':
        return std::ispunct(code) != 0;
      case 's':
        return std::isspace(code) != 0;
      case 'u':
        return std::isupper(code) != 0;
      case 'w':
        return std::isalnum(code) != 0;
      case 'z':
        return code == 0;
      default:
        return std::isxdigit(code) != 0;
    }
  };
  constexpr std::string_view kLetters = "acdglpsuwxz";
  if (kLetters.find(static_cast<char>(std::tolower(byte_of(letter)))) == std::string_view::npos)
    return letter == c;
  return holds() == (std::islower(byte_of(letter)) != 0);
}

/// One pattern on one subject; `s` is a place in the subject, `p` one in the pattern. Alternatives
/// are tried by recursion, so the captures are undone where one fails.
class Matcher {
 public:
  Matcher(std::string_view subject, std::string_view pattern, PatternSteps& steps)
      : subject_(subject), pattern_(pattern), steps_(steps) {}

  std::optional<PatternMatch> at(std::size_t begin, std::size_t first) {
    captures_.clear();
    const std::size_t end = match(begin, first);
    if (end == kNone) return std::nullopt;
    PatternMatch found{begin, end};
    for (const Open& one : captures_) {
      if (one.open) throw PatternError("unfinished capture");
      found.captures.push_back(one.capture);
    }
    return found;
  }

 private:
  struct Open {
    PatternCapture capture;
    bool open = true;
  };

  void step() {
    if (--steps_.left < 0) steps_.use_up();
  }
  bool more(std::size_t p) const { return p < pattern_.size(); }

  /// Where the single-character class at `p` ends.
  std::size_t class_end(std::size_t p) const {
    if (pattern_[p] == kEscape) {
      if (!more(p + 1)) throw PatternError("malformed pattern (ends with '%')");
      return p + 2;
    }
    if (pattern_[p] != '[') return p + 1;
    ++p;
    if (more(p) && pattern_[p] == '^') ++p;
    do {  // a ] at the very beginning is itself
      if (!more(p)) throw PatternError("malformed pattern (missing ']')");
      if (pattern_[p++] == kEscape) ++p;
    } while (!more(p) || pattern_[p] != ']');
    return p + 1;
  }

  /// A set from its [ to its ].
  bool in_set(char c, std::size_t p, std::size_t last) {
    bool wanted = true;
    if (pattern_[p + 1] == '^') {
      wanted = false;
      ++p;
    }
    while (++p < last) {
      step();
      if (pattern_[p] == kEscape) {
        ++p;
        if (in_class(c, pattern_[p])) return wanted;
      } else if (p + 2 < last && pattern_[p + 1] == '-') {
        p += 2;
        if (byte_of(pattern_[p - 2]) <= byte_of(c) && byte_of(c) <= byte_of(pattern_[p]))
          return wanted;
      } else if (pattern_[p] == c) {
        return wanted;
      }
    }
    return !wanted;
  }

  bool single(std::size_t s, std::size_t p, std::size_t end) {
    step();
    if (s >= subject_.size()) return false;
    switch (pattern_[p]) {
      case '.':
        return true;
      case kEscape:
        return in_class(subject_[s], pattern_[p + 1]);
      case '[':
        return in_set(subject_[s], p, end - 1);
      default:
        return pattern_[p] == subject_[s];
    }
  }

  std::size_t balanced(std::size_t s, std::size_t p) {
    if (p + 1 >= pattern_.size())
      throw PatternError("malformed pattern (missing arguments to '%b')");
    if (s >= subject_.size() || subject_[s] != pattern_[p]) return kNone;
    int depth = 1;
    while (++s < subject_.size()) {
      step();
      if (subject_[s] == pattern_[p + 1]) {
        if (--depth == 0) return s + 1;
      } else if (subject_[s] == pattern_[p]) {
        ++depth;
      }
    }
    return kNone;
  }

  /// `*` and `+`: as many as there are, then one less each time that the rest does not match.
  std::size_t longest(std::size_t s, std::size_t p, std::size_t end) {
    std::size_t count = 0;
    while (single(s + count, p, end)) ++count;
    for (;;) {
      const std::size_t rest = match(s + count, end + 1);
      if (rest != kNone || count == 0) return rest;
      --count;
    }
  }

  /// `-`: one more each time that the rest does not match.
  std::size_t shortest(std::size_t s, std::size_t p, std::size_t end) {
    for (;;) {
      const std::size_t rest = match(s, end + 1);
      if (rest != kNone) return rest;
      if (!single(s, p, end)) return kNone;
      ++s;
    }
  }

  std::size_t open_capture(std::size_t s, std::size_t p, bool position) {
    if (captures_.size() >= kMostCaptures) throw PatternError("too many captures");
    captures_.push_back({{s, 0, position}, !position});
    const std::size_t rest = match(s, p);
    if (rest == kNone) captures_.pop_back();
    return rest;
  }

  std::size_t close_capture(std::size_t s, std::size_t p) {
    const auto last = std::find_if(captures_.rbegin(), captures_.rend(),
                                   [](const Open& one) { return one.open; });
    if (last == captures_.rend()) throw PatternError("invalid pattern capture");
    const auto index = static_cast<std::size_t>(captures_.rend() - last) - 1;
    captures_[index].capture.size = s - captures_[index].capture.begin;
    captures_[index].open = false;
    const std::size_t rest = match(s, p);
    if (rest == kNone) captures_[index].open = true;
    return rest;
  }

  /// %1: the same text again.
  std::size_t again(std::size_t s, char digit) {
    const std::size_t index = static_cast<std::size_t>(digit - '1');
    if (digit == '0' || index >= captures_.size() || captures_[index].open)
      throw PatternError("invalid capture index %" + std::to_string(digit - '0'));
    const PatternCapture& capture = captures_[index].capture;
    if (capture.position) return kNone;
    // One comparison of a long text is many steps' work.
    steps_.left -= static_cast<std::int64_t>(capture.size / 8);
    step();
    if (subject_.size() - s < capture.size ||
        subject_.substr(s, capture.size) != subject_.substr(capture.begin, capture.size))
      return kNone;
    return s + capture.size;
  }

  /// %f[set]: where a text of the set begins.
  bool frontier(std::size_t s, std::size_t p, std::size_t end) {
    const char before = s == 0 ? '\0' : subject_[s - 1];
    const char here = s < subject_.size() ? subject_[s] : '\0';
    return !in_set(before, p, end - 1) && in_set(here, p, end - 1);
  }

  /// Where the match of the pattern from `p` on ends, that begins at `s`; kNone for none.
  std::size_t match(std::size_t s, std::size_t p) {
    struct Depth {
      int& depth;
      explicit Depth(int& of) : depth(of) {
        if (++depth > kMostDepth) throw PatternError("pattern too complex");
      }
      ~Depth() { --depth; }
    } const depth(depth_);
    while (more(p)) {
      step();
      if (pattern_[p] == '(') {
        const bool position = more(p + 1) && pattern_[p + 1] == ')';
        return open_capture(s, position ? p + 2 : p + 1, position);
      }
      if (pattern_[p] == ')') return close_capture(s, p + 1);
      if (pattern_[p] == '$' && !more(p + 1)) return s == subject_.size() ? s : kNone;
      if (!(pattern_[p] == kEscape && more(p + 1) ? special(s, p) : ordinary(s, p))) return result_;
    }
    return s;
  }

  /// %b, %f, %1; what else begins with % is an ordinary class. Whether the match goes on, from `s`
  /// and `p`; else its end is in result_.
  bool special(std::size_t& s, std::size_t& p) {
    const char letter = pattern_[p + 1];
    if (letter == 'b') {
      s = balanced(s, p + 2);
      p += 4;
      return s != kNone || ended(kNone);
    }
    if (letter == 'f') {
      p += 2;
      if (!more(p) || pattern_[p] != '[') throw PatternError("missing '[' after '%f' in pattern");
      const std::size_t end = class_end(p);
      if (!frontier(s, p, end)) return ended(kNone);
      p = end;
      return true;
    }
    if (letter >= '0' && letter <= '9') {
      s = again(s, letter);
      p += 2;
      return s != kNone || ended(kNone);
    }
    return ordinary(s, p);
  }

  bool ordinary(std::size_t& s, std::size_t& p) {
    const std::size_t end = class_end(p);
    const char suffix = more(end) ? pattern_[end] : '\0';
    if (suffix == '*') return ended(longest(s, p, end));
    if (suffix == '-') return ended(shortest(s, p, end));
    const bool here = single(s, p, end);
    if (suffix == '+') return ended(here ? longest(s + 1, p, end) : kNone);
    if (suffix == '?') {
      if (here) {
        const std::size_t rest = match(s + 1, end + 1);
        if (rest != kNone) return ended(rest);
      }
      p = end + 1;
      return true;
    }
    if (!here) return ended(kNone);
    ++s;
    p = end;
    return true;
  }

  bool ended(std::size_t result) {
    result_ = result;
    return false;
  }

  std::string_view subject_;
  std::string_view pattern_;
  PatternSteps& steps_;
  std::vector<Open> captures_;
  std::size_t result_ = kNone;
  int depth_ = 0;
};

}  // namespace

std::optional<PatternMatch> match_pattern_at(std::string_view subject, std::string_view pattern,
                                             std::size_t at, PatternSteps& steps) {
  return Matcher(subject, pattern, steps).at(at, 0);
}

std::optional<PatternMatch> find_pattern(std::string_view subject, std::string_view pattern,
                                         std::size_t from, PatternSteps& steps) {
  const bool held = !pattern.empty() && pattern.front() == '^';
  Matcher matcher(subject, pattern, steps);
  for (std::size_t begin = from; begin <= subject.size(); ++begin) {
    if (auto found = matcher.at(begin, held ? 1 : 0)) return found;
    if (held) break;
  }
  return std::nullopt;
}

}  // namespace vitreo::scripted
