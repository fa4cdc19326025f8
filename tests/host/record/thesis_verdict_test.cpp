// SPDX-License-Identifier: Apache-2.0
#include "host/record/thesis_verdict.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

ThesisVerdict verdict_of(const JudgedNumber& number) { return judge(number).verdict; }

// Table 6.1: upper-middle by one camera is 53 ± 14 µm/s.
JudgedNumber upper_middle(double ours) { return {.ours = ours, .thesis = 53e-6, .spread = 14e-6}; }

TEST(ThesisVerdict, ANumberIsReproducedWithinTwoPrintedSpreadsOnEitherSide) {
  for (const double off : {-27.9e-6, -13e-6, 0.0, 27.9e-6}) {
    const JudgedVerdict judged = judge(upper_middle(53e-6 + off));
    EXPECT_EQ(judged.verdict, ThesisVerdict::reproduced) << off;
    EXPECT_NEAR(judged.deviation.value(), std::abs(off) / 14e-6, 1e-9);
  }
  EXPECT_EQ(verdict_of(upper_middle(53e-6 + 28.1e-6)), ThesisVerdict::differs);
  EXPECT_EQ(verdict_of(upper_middle(53e-6 - 28.1e-6)), ThesisVerdict::differs)
      << "smaller is no better where it is no error of the same kind";
}

TEST(ThesisVerdict, OnlyTheSameErrorWithNoiseAndDoubtInCanBeBetter) {
  JudgedNumber depth{.ours = 121e-6, .thesis = 249e-6, .same_error = true};
  EXPECT_EQ(verdict_of(depth), ThesisVerdict::better);
  depth.ours = 250e-6;
  EXPECT_EQ(verdict_of(depth), ThesisVerdict::differs);
  const JudgedNumber sensitivity{.ours = 25e-6, .thesis = 282e-6};
  EXPECT_EQ(verdict_of(sensitivity), ThesisVerdict::shown);
  depth.ours = 230e-6, depth.spread = 20e-6;
  EXPECT_EQ(verdict_of(depth), ThesisVerdict::reproduced) << "what is as large is not better";
}

TEST(ThesisVerdict, ABoundIsAGoalUnlessTheThesisPrintsIt) {
  JudgedNumber hold{.ours = 3e-6, .at_most = 5e-6};
  EXPECT_EQ(verdict_of(hold), ThesisVerdict::goal_met);
  hold.ours = 6e-6;
  EXPECT_EQ(verdict_of(hold), ThesisVerdict::goal_missed);
  JudgedNumber field{.ours = 1.6, .at_most = 1.75, .printed = true};
  EXPECT_EQ(verdict_of(field), ThesisVerdict::reproduced);
  field.ours = 1.8;
  EXPECT_EQ(verdict_of(field), ThesisVerdict::differs);
  EXPECT_EQ(verdict_of({.ours = 4, .at_least = 3, .at_most = 5}), ThesisVerdict::goal_met);
  EXPECT_EQ(verdict_of({.ours = 2, .at_least = 3, .at_most = 5}), ThesisVerdict::goal_missed);
}

TEST(ThesisVerdict, WithoutAnAnswerNothingIsReproducedAndNoGoalIsMet) {
  for (const auto& none : {std::optional<double>(), std::optional<double>(std::nan(""))}) {
    EXPECT_EQ(verdict_of({.ours = none, .at_most = 1}), ThesisVerdict::goal_missed);
    EXPECT_EQ(verdict_of({.ours = none, .thesis = 1, .spread = 1}), ThesisVerdict::differs);
    EXPECT_EQ(verdict_of({.ours = none, .thesis = 1, .same_error = true}), ThesisVerdict::differs);
    EXPECT_EQ(verdict_of({.ours = none, .thesis = 1}), ThesisVerdict::shown);
  }
}

TEST(ThesisVerdict, WhatContradictsItselfIsRefused) {
  EXPECT_THROW(judge({.ours = 1, .spread = 1}), std::invalid_argument);
  EXPECT_THROW(judge({.ours = 1, .within = 1}), std::invalid_argument);
  EXPECT_THROW(judge({.ours = 1, .same_error = true}), std::invalid_argument);
  EXPECT_THROW(judge({.ours = 1, .thesis = 1, .spread = 0}), std::invalid_argument);
  EXPECT_THROW(judge({.ours = 1, .thesis = 1, .at_most = 2}), std::invalid_argument)
      << "a goal beside a printed number would call it met where it differs";
}

TEST(ThesisVerdict, TheCountsAreApartAndWordsGoBothWays) {
  VerdictCounts counts;
  for (const ThesisVerdict verdict : kThesisVerdicts) {
    EXPECT_EQ(thesis_verdict_named(to_string(verdict)), verdict);
    counts.count(to_string(verdict));
  }
  counts.count("goal met");
  counts.count("agrees");  // of an older record
  EXPECT_EQ(counts.text(),
            "1 reproduced, 1 better than the thesis, 2 goals met, 1 goal missed, 1 differs, "
            "1 shown");
  EXPECT_EQ(VerdictCounts().text(), "0 goals missed, 0 differ");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
