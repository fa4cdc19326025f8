// Questions to the operator: answered in advance, at the terminal, through the control socket; and
// reminders.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/run/run_control_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

struct OperatorQuestions : RunControlTest {};

TEST_F(OperatorQuestions, QuestionsTakeAnswersGivenInAdvanceByNameAndInTheirOrder) {
  request.what.answers = {"depth=3mm", "yes", "2"};
  const RunResult result =
      run("print(run:confirm('ready?'))\n"
          "print(run:ask('how deep?', { name = 'depth', unit = 'mm', min = 0, max = 8*mm }))\n"
          "print(run:ask('which?', { type = 'integer' }))");
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_NE(ear.said.find("true;"), std::string::npos) << ear.said;
  EXPECT_NE(ear.said.find("0.003;"), std::string::npos) << ear.said;
  EXPECT_NE(ear.said.find(";2;"), std::string::npos) << ear.said;
  EXPECT_NE(events.find("answer:3mm (given in advance)"), std::string::npos) << events;
}

TEST_F(OperatorQuestions, AnAnswerThatDoesNotDoIsSaidWhyAndTheQuestionStaysOpen) {
  ear.lines = {"3", "12mm", "4mm"};
  const RunResult result =
      run("print(run:ask('how deep?', { name = 'depth', unit = 'mm', min = 0, max = 8*mm }))");
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_NE(ear.said.find("depth: wants a length"), std::string::npos) << ear.said;
  EXPECT_NE(ear.said.find("0 to 8 mm; got 12mm"), std::string::npos) << ear.said;
  EXPECT_NE(ear.said.find("0.004;"), std::string::npos) << ear.said;
}

TEST_F(OperatorQuestions, AQuestionOfYesOrNoTakesALetterAndSaysWhatItWants) {
  ear.lines = {"perhaps", " Y \r", "n"};
  const RunResult result = run("print(run:confirm('ready?'))\nprint(run:confirm('sure?'))");
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_NE(ear.said.find("wants yes or no; got 'perhaps'"), std::string::npos) << ear.said;
  EXPECT_NE(ear.said.find("true;"), std::string::npos) << ear.said;
  EXPECT_TRUE(ear.said.ends_with("false;")) << ear.said;
}

TEST_F(OperatorQuestions, TasksThatAskAtOnceGetEachItsOwnAnswer) {
  ear.lines = {"3", "left", "4mm"};
  const RunResult result =
      run("run:together(function() print('a', run:ask('how many?', { type = 'integer' })) end,\n"
          "  function() print('b', run:ask('which?', { choices = { 'left', 'right' } })) end,\n"
          "  function() print('c', run:ask('how deep?', { unit = 'mm' })) end)");
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  for (const char* answer : {"a\t3;", "b\tleft;", "c\t0.004;"})
    EXPECT_NE(ear.said.find(answer), std::string::npos) << ear.said;
}

TEST_F(OperatorQuestions, AQuestionWhoseTaskHasEndedDoesNotStandInTheWayOfTheNext) {
  request.how.pace = Pace::real_time;
  ear.on_message = [this](const std::string& line) {
    if (line == "boom") ear.lines = {"yes"};
  };
  const RunResult result =
      run("local ok, why = pcall(run.together, run, function() run:confirm('first?') end,\n"
          "  function() run:wait(0.02*s) error('boom', 0) end)\nprint(why)\n"
          "print(run:confirm('second?', { timeout = 20*s }))");
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_TRUE(ear.said.ends_with("true;")) << ear.said;
}

TEST_F(OperatorQuestions, QuestionsThatNobodyCouldAnswerAreRefused) {
  for (const auto& [options, complaint] : std::vector<std::pair<std::string, std::string>>{
           {"min = 3*mm, max = 1*mm, unit = 'mm'", "min: 3 mm is above max, 1 mm"},
           {"type = 'integer', min = 1.2, max = 1.8", "no whole number from 1.2 to 1.8"},
           {"default = 'x'", "default: wants a number, got a string"},
           {"default = 5, max = 3", "default: 5 is not from"},
           {"type = 'integer', default = 1.5", "default: wants a whole number"},
           {"choices = { 'a', 'b' }, default = 'c'", "default: 'c' is not among the choices"},
           {"type = 'text', unit = 'mm'", "unit: is not for answers of this type"},
           {"type = 'number', choices = { 'a' }", "choices: is not for answers of this type"},
           {"choices = {}", "choices: the list is empty"},
           {"type = 'choice'", "choices: wants the list"},
           {"unit = 'parsec'", "parsec is not a unit"}}) {
    const RunResult result = run("run:ask('what?', { " + options + " })");
    EXPECT_EQ(result.outcome, Outcome::failed) << options;
    EXPECT_NE(result.reason.find(complaint), std::string::npos) << options << ": " << result.reason;
  }
}

TEST_F(OperatorQuestions, AnswersGivenInAdvanceForWhichNoQuestionCameAreTold) {
  request.what.answers = {"dept=3mm", "yes", "no"};
  ear.lines = {"2mm"};
  const RunResult result =
      run("print(run:confirm('ready?'))\nprint(run:ask('how deep?', { name = 'depth', unit = 'mm', "
          "timeout = 9*s }))");
  EXPECT_EQ(result.outcome, Outcome::failed) << "the second answer in their order is no depth";
  request.what.answers = {"dept=3mm", "ready=yes"};
  EXPECT_EQ(run("print(run:confirm('ready?', { name = 'ready' }))\n"
                "print(run:ask('how deep?', { name = 'depth', unit = 'mm' }))")
                .outcome,
            Outcome::completed);
  EXPECT_NE(
      events.find("note:nothing was asked that wanted the answer dept=3mm; did you mean depth?"),
      std::string::npos)
      << events;
  EXPECT_EQ(events.find("ready=yes;"), std::string::npos) << events;
}

TEST_F(OperatorQuestions, AWrongAnswerGivenInAdvanceFailsTheRunNamingTheQuestion) {
  request.what.answers = {"depth=deep"};
  const RunResult result = run("run:ask('how deep?', { name = 'depth', unit = 'mm' })");
  EXPECT_EQ(result.outcome, Outcome::failed);
  EXPECT_NE(result.reason.find("depth: wants a length"), std::string::npos) << result.reason;
}

TEST_F(OperatorQuestions, RemindersComeBackUntilTheyAreClosed) {
  run("do local r <close> = run:remind('drops', { every = 10*s })\nrun:wait(35*s) "
      "end\nrun:wait(60*s)");
  EXPECT_EQ(ear.said, "reminder: drops;reminder: drops;reminder: drops;");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
