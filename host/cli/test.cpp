// `vitreo test PROTOCOL`: whether it completes, fails as it should, and can be stopped at any moment.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/protocol_check.h"

#include <fmt/format.h>

namespace vitreo::cli {
namespace {

struct Wanted : RunOptions {
  std::string protocol;
  int stops = 0;
};

int test(Program& program, Wanted& wanted) {
  wanted.request.protocol_file = Program::protocol_file(wanted.protocol);
  const RunRequest& base = wanted.complete(program);
  std::vector<ProtocolTest> tests = program.engine().describe(base.protocol_file).tests;
  if (tests.empty()) {
    tests = usual_tests();
    for (ProtocolTest& one : tests) {
      one.seed = base.seed;
      for (const std::string& word : base.arguments) one.arguments += word + " ";
      for (const std::string& word : base.answers) one.answers += word + " ";
    }
  }
  int runs = 0, failed = 0;
  for (ProtocolTest& one : tests) {
    if (!one.rig.empty()) one.rig = Program::rig_file(one.rig);
    if (wanted.stops > 0) one.times = wanted.stops;
    try_protocol(program.engine(), base, one, [&](const ProtocolTrial& trial) {
      ++runs;
      failed += !trial.problem.empty();
      fmt::print("{} {}{}{}\n", trial.problem.empty() ? "passed" : "FAILED", trial.what,
                 trial.problem.empty() ? "" : ": ", trial.problem);
    });
  }
  fmt::print("{} of {} runs passed\n", runs - failed, runs);
  return failed == 0 ? 0 : 1;
}

}  // namespace

void add_test(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<Wanted>();
  Command command = line.command("test", "puts a protocol to its own tests, or stops it at 100 moments",
                                 [&program, wanted] { return test(program, *wanted); });
  add_run_options(command, *wanted);
  command.option("protocol", wanted->protocol, "a protocol's file or name").required();
  command.option("arguments", wanted->request.arguments, "of a protocol that lists no tests: name=value");
  command.option("--answer", wanted->request.answers, "answers to its questions: name=value");
  command.option("--stops", wanted->stops, "so many moments instead (default: 100)").between(1, 100000);
}

}  // namespace vitreo::cli
