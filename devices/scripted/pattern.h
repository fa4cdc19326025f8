// Patterns of Lua with a bound on their work: the same language as string.match, matched step by
// step, so that one that goes back and forth over a long text ends.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <vector>

namespace vitreo::scripted {

/// A pattern that is none: "malformed pattern (missing ']')".
class PatternError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
/// A match that took more steps than it may.
class PatternWork : public std::runtime_error {
 public:
  PatternWork() : std::runtime_error("the pattern takes too many steps on this text") {}
};

/// Steps that a match may take: each comparison takes one.
class PatternSteps {
 public:
  explicit PatternSteps(std::int64_t some) : left(some) {}
  virtual ~PatternSteps() = default;
  PatternSteps(const PatternSteps&) = delete;
  PatternSteps& operator=(const PatternSteps&) = delete;
  std::int64_t left;
  /// None is left: throws, or gives more.
  virtual void use_up() { throw PatternWork(); }
};

struct PatternCapture {
  std::size_t begin = 0;  ///< in the subject
  std::size_t size = 0;
  bool position = false;  ///< "()": begin alone counts
};

struct PatternMatch {
  std::size_t begin = 0;
  std::size_t end = 0;
  std::vector<PatternCapture> captures{};  ///< 32 at most, as in Lua
};

/// The first match of `pattern` (Lua 5.4 reference manual, 6.4.1) that begins at or after `from`; a
/// leading ^ holds it there. Throws PatternError, and what the steps throw.
std::optional<PatternMatch> find_pattern(std::string_view subject, std::string_view pattern,
                                         std::size_t from, PatternSteps& steps);
/// The match that begins exactly at `at`; a leading ^ is a plain character here.
std::optional<PatternMatch> match_pattern_at(std::string_view subject, std::string_view pattern,
                                             std::size_t at, PatternSteps& steps);

}  // namespace vitreo::scripted
