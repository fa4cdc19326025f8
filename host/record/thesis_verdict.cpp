// SPDX-License-Identifier: Apache-2.0
#include "host/record/thesis_verdict.h"

#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

// In the order of the enumeration: the word of a row, and what follows a count of one and of many.
struct VerdictWords {
  std::string_view word;
  std::string_view one;
  std::string_view many;
};

constexpr std::array<VerdictWords, kThesisVerdicts.size()> kVerdictWords{
    {{"reproduced", "reproduced", "reproduced"},
     {"better", "better than the thesis", "better than the thesis"},
     {"goal met", "goal met", "goals met"},
     {"goal missed", "goal missed", "goals missed"},
     {"differs", "differs", "differ"},
     {"shown", "shown", "shown"}}};

// kVerdictWords has one entry a value, so no verdict is without words.
const VerdictWords& words(ThesisVerdict verdict) {
  return kVerdictWords[static_cast<std::size_t>(verdict)];
}

// What contradicts itself would be judged by whichever measure comes first, unseen: a number of the
// thesis with a goal of ours beside it could differ and still be called met.
void check(const JudgedNumber& number) {
  const bool bounded = number.at_least || number.at_most;
  const auto refuse = [](const char* what) { throw std::invalid_argument(what); };
  if (!number.thesis && number.spread) refuse("spread: wants the thesis' number");
  if (!number.thesis && number.within) refuse("within: wants the thesis' number");
  if (!number.thesis && number.same_error) refuse("error: wants the thesis' number");
  if (number.spread && !(*number.spread > 0)) refuse("spread: must be above 0");
  if (number.thesis && bounded && !number.printed)
    refuse("at_most, at_least: a goal is of a number that the thesis does not print");
  if (bounded && (number.spread || number.within))
    refuse("at_most, at_least: with spread or within there are two measures");
}

// The sides of a bound are inclusive.
bool inside(const JudgedNumber& number, double ours) {
  return (!number.at_least || ours >= *number.at_least) &&
         (!number.at_most || ours <= *number.at_most);
}

// |ours - thesis| against the spread that the thesis prints, else against its digits. An error that
// is smaller than the thesis' own beyond these is better; without either, any smaller one is.
ThesisVerdict beside_the_thesis(const JudgedNumber& number, double ours,
                                std::optional<double> deviation) {
  const double off = std::abs(ours - *number.thesis);
  if (deviation && *deviation <= kSpreadsReproduced) return ThesisVerdict::reproduced;
  if (number.within && off <= *number.within) return ThesisVerdict::reproduced;
  if (number.same_error && ours <= *number.thesis) return ThesisVerdict::better;
  if (number.spread || number.within || number.same_error) return ThesisVerdict::differs;
  return ThesisVerdict::shown;
}

}  // namespace

// These words are in expectations.json and in docs/reproduction.md: another word is another
// verdict to every reader of old runs.
std::string_view to_string(ThesisVerdict verdict) { return words(verdict).word; }

std::optional<ThesisVerdict> thesis_verdict_named(std::string_view word) {
  for (const ThesisVerdict verdict : kThesisVerdicts)
    if (to_string(verdict) == word) return verdict;
  return std::nullopt;
}

JudgedVerdict judge(const JudgedNumber& number) {
  check(number);
  const bool bounded = number.at_least || number.at_most;
  // JSON and Lua have NaN where nothing was measured; an infinite value is an answer, a bad one.
  const bool answered = number.ours && !std::isnan(*number.ours);
  if (bounded) {
    const bool good = answered && inside(number, *number.ours);
    if (number.printed) return {good ? ThesisVerdict::reproduced : ThesisVerdict::differs};
    return {good ? ThesisVerdict::goal_met : ThesisVerdict::goal_missed};
  }
  // Neither a bound nor a number of the thesis: there is nothing to judge by.
  if (!number.thesis) return {ThesisVerdict::shown};
  const bool judged = number.spread || number.within || number.same_error;
  if (!answered) return {judged ? ThesisVerdict::differs : ThesisVerdict::shown};
  std::optional<double> deviation;
  if (number.spread) deviation = std::abs(*number.ours - *number.thesis) / *number.spread;
  return {beside_the_thesis(number, *number.ours, deviation), deviation};
}

// An unknown word, as of a record of another version, is in no count.
void VerdictCounts::count(std::string_view word) {
  if (const auto verdict = thesis_verdict_named(word))
    ++counts_[static_cast<std::size_t>(*verdict)];
}

// Goals missed and what differs are told even where there are none: their absence is the news.
std::string VerdictCounts::text() const {
  std::string text;
  for (const ThesisVerdict verdict : kThesisVerdicts) {
    const int count = of(verdict);
    const bool always = verdict == ThesisVerdict::goal_missed || verdict == ThesisVerdict::differs;
    if (count == 0 && !always) continue;
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " ";
    text += count == 1 ? words(verdict).one : words(verdict).many;
  }
  return text;
}

}  // namespace vitreo
