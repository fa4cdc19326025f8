// `vitreo test PROTOCOL`: tests that it completes, fails as it should, and can be stopped at any
// moment.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/config/config.h"
#include "host/record/record_json.h"
#include "host/trials/protocol_check.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace vitreo::cli {
namespace {

struct TestWords : ProtocolOptions {
  int stops = 0;  // 0: as the test says
};

/// Those that the protocol lists, else the usual ones with the arguments that were given.
/// Arguments of the command line would contradict tests that state their own, so they are refused
/// rather than ignored.
std::vector<ProtocolTest> tests_of(Program& program, const RunRequest& base) {
  std::vector<ProtocolTest> tests = program.engine().describe(base.what.protocol_file).tests;
  if (!tests.empty()) {
    if (!base.what.arguments.empty() || !base.what.answers.empty())
      throw ConfigError(base.what.protocol_file +
                        ": lists its own tests, which say their arguments and answers");
    return tests;
  }
  tests = usual_tests();
  for (ProtocolTest& one : tests) one.seed = base.how.seed;
  return tests;
}

// A stop test reports a trial for each of its stops, so runs are counted in the call-back and not
// by the tests.
int test(Program& program, TestWords& wanted) {
  const RunRequest& base = wanted.complete(program);
  int runs = 0;
  int failed = 0;
  for (ProtocolTest& one : tests_of(program, base)) {
    if (!one.rig.empty()) one.rig = Program::rig_file(one.rig);
    if (wanted.stops > 0) one.times = wanted.stops;
    try_protocol(program.engine(), base, one, [&](const ProtocolTrial& trial) {
      ++runs;
      failed += !trial.problem.empty();
      const nlohmann::json row{
          {"what", trial.what}, {"passed", trial.problem.empty()}, {"problem", trial.problem}};
      if (wanted.json)
        fmt::print("{}\n", dumped(row));
      else
        fmt::print("{} {}{}{}\n", trial.problem.empty() ? "passed" : "FAILED", trial.what,
                   trial.problem.empty() ? "" : ": ", trial.problem);
    });
  }
  if (wanted.json)
    fmt::print("{}\n", nlohmann::json{{"runs", runs}, {"failed", failed}}.dump());
  else
    fmt::print("{} of {} runs passed\n", runs - failed, runs);
  return failed == 0 ? 0 : 1;
}

}  // namespace

void add_test(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<TestWords>();
  Command command =
      line.command("test", "puts a protocol to its own tests, or stops it at 100 moments",
                   [&program, wanted] { return test(program, *wanted); });
  add_run_options(command, *wanted);
  command.option("protocol", wanted->protocol, "a protocol's file or name").required();
  command.option("arguments", wanted->request.what.arguments,
                 "of a protocol that lists no tests: name=value");
  command.option("--answer", wanted->request.what.answers, "answers to its questions: name=value")
      .one_word_each();
  command.option("--stops", wanted->stops, "so many moments instead (default: 100)")
      .between(1, 100000);
  command.flag("--json", wanted->json,
               "a JSON object a run, and one at the end: {\"runs\", \"failed\"}");
  command.examples({"vitreo test servo_square", "vitreo test ./mine.lua speed=0.5mm/s --stops 20"});
}

}  // namespace vitreo::cli
