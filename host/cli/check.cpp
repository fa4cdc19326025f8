// `vitreo check`: preflight of a run, what it would do and whether it would be let, without
// touching an instrument.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/engine/rehearsal.h"
#include "host/record/record_json.h"

#include <fmt/format.h>

#include <iostream>
#include <unistd.h>

namespace vitreo::cli {
namespace {

struct Check : ProtocolOptions {
  double limit = 10;  // s of wall time
};

void show(const PreflightReport& report, bool json) {
  if (json)
    std::cout << dumped(to_json(report)) << std::endl;
  else
    std::cout << to_text(report) << std::flush;
}

// The report is printed on both ways out, also by the call-back of a stuck script, so that what was
// found until then is not lost.
int check(Program& program, Check& wanted) {
  PreflightLimits limits;
  limits.wall = wanted.limit;
  // A script that does not end cannot be unwound: the report is shown, and the process left.
  // _exit() and not exit(): static destructors would run beside the thread that is stuck.
  limits.stuck = [&wanted](const PreflightReport& report) {
    show(report, wanted.json);
    _exit(static_cast<int>(ExitCode::preflight_failed));
  };
  const PreflightReport report = preflight(program.engine(), wanted.complete(program), limits);
  show(report, wanted.json);
  return static_cast<int>(report.passed() ? ExitCode::completed : ExitCode::preflight_failed);
}

}  // namespace

void add_check(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<Check>();
  Command command = line.command("check",
                                 "whether a run would be let, and what it would move and energize: "
                                 "a dry run on the rig's twin",
                                 [&program, wanted] { return check(program, *wanted); });
  command.option("--rig", wanted->request.where.rig_file,
                 "a rig's file or name (default: the protocol's own, else simulated)");
  command.option("--seed", wanted->request.how.seed,
                 "of everything that is drawn by chance (default: 1)");
  command.option("--out", wanted->request.where.out,
                 "folder in which the run's would be (default: runs)");
  command.option("--frames", wanted->request.what.frames, "cameras whose frames would be recorded")
      .one_word_each()
      .delimiter(',');
  command.option("protocol", wanted->protocol, "a protocol's file or name").required();
  command.option("arguments", wanted->request.what.arguments,
                 "name=value, with units: speed=0.5mm/s");
  command
      .option("--answer", wanted->request.what.answers,
              "answers a question of the script: name=value, or value")
      .one_word_each();
  command.seconds("--limit", wanted->limit, "wall time for the dry run (default: 10s)");
  command.flag("--json", wanted->json, "one JSON object, SI units");
  command.examples({"vitreo check servo_square speed=0.5mm/s"});
}

}  // namespace vitreo::cli
