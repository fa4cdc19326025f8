// Verdicts on numbers beside the thesis: the words, what earns each of them, and their counts.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace vitreo {

/// Counted apart everywhere: a goal of this project that is met says nothing about the thesis.
enum class ThesisVerdict {
  reproduced,   // within the thesis' printed spread, digits or words
  better,       // the same error measured, ours smaller, noise and doubt in
  goal_met,     // a bound of this project; the thesis has no number
  goal_missed,  // the same, or there was no answer
  differs,      // beyond what the thesis printed
  shown         // told beside the thesis, and not judged
};

constexpr std::array<ThesisVerdict, 6> kThesisVerdicts{
    ThesisVerdict::reproduced,  ThesisVerdict::better,  ThesisVerdict::goal_met,
    ThesisVerdict::goal_missed, ThesisVerdict::differs, ThesisVerdict::shown};

/// "goal met".
std::string_view to_string(ThesisVerdict verdict);
/// Nothing for a word that is none of them.
std::optional<ThesisVerdict> thesis_verdict_named(std::string_view word);

/// A number with what is known of it, SI. Without an answer (`ours` absent or no number) nothing is
/// reproduced and no goal is met.
struct JudgedNumber {
  std::optional<double> ours{};
  std::optional<double> thesis{};  // as printed
  std::optional<double> spread{};  // printed with it: a standard deviation or an uncertainty
  std::optional<double> within{};  // half of the last digit printed, or the span its words leave
  std::optional<double> at_least{};
  std::optional<double> at_most{};
  bool printed = false;     // the bounds are the thesis' own words, not a goal of this project
  bool same_error = false;  // an error as the thesis measured it, with noise and doubt in ours
};

struct JudgedVerdict {
  ThesisVerdict verdict = ThesisVerdict::shown;
  std::optional<double> deviation{};  // from the thesis, in printed spreads
};

/// Printed spreads within which a number counts as reproduced: 95 % of those of the same
/// distribution.
constexpr double kSpreadsReproduced = 2;

/// Throws std::invalid_argument naming what contradicts: a spread without the thesis' number, or an
/// own bound beside it.
JudgedVerdict judge(const JudgedNumber& number);

/// Numbers by verdict.
class VerdictCounts {
 public:
  void count(std::string_view word);
  int of(ThesisVerdict verdict) const { return counts_[static_cast<std::size_t>(verdict)]; }
  /// "8 reproduced, 3 better than the thesis, 20 goals met, 1 goal missed, 4 differ, 9 shown"; what
  /// there is none of is left out, but for goals missed and what differs.
  std::string text() const;

 private:
  std::array<int, kThesisVerdicts.size()> counts_{};
};

}  // namespace vitreo
