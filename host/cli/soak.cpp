// `vitreo soak`: soak test, a protocol under faults, stops and kills drawn from seeds.
// SPDX-License-Identifier: Apache-2.0
#include "host/trials/soak.h"

#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/record/record_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <thread>

namespace vitreo::cli {
namespace {

// A seed that was not given: 0 is a seed like any other.
constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();

struct SoakWords : ProtocolOptions {
  std::uint64_t first = 1;
  std::uint64_t seeds = 100;
  std::uint64_t seed = kNone;  // only this one
  std::uint64_t run_seed = 1;
  int jobs = 0;  // 0: one a core
  bool slurm = false;
  int tasks = 16;
};

// Two kinds of seeds: the plan's draws the disturbances, the run's the simulated rig. The latter is
// the same for all plans, so that each run can be compared with one undisturbed reference.
int soak_protocol(Program& program, SoakWords& wanted) {
  SoakRequest request;
  wanted.request.how.seed = wanted.run_seed;
  request.run = wanted.complete(program);
  request.first = wanted.seed == kNone ? wanted.first : wanted.seed;
  request.count = wanted.seed == kNone ? wanted.seeds : 1;
  const int cores = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  request.jobs = wanted.jobs > 0 ? wanted.jobs : cores;
  if (wanted.slurm)
    request.slurm =
        SlurmRequest{std::filesystem::read_symlink("/proc/self/exe").string(), wanted.tasks, {}};
  request.note = [](const std::string& text) { fmt::print(stderr, "{}\n", text); };
  // Flushed for each seed: a soak may run for hours, and is watched through a pipe or a log.
  const SoakResult result = soak(program.engine(), request, [&](const SoakedSeed& one) {
    fmt::print("{}", wanted.json ? dumped(to_json(one)) + "\n" : to_text(one));
    std::fflush(stdout);
  });
  if (wanted.json)
    fmt::print("{}\n", dumped(to_json(result)));
  else
    fmt::print("{} seeds, {} violations, {:.0f} s\n", result.seeds, result.violations,
               result.seconds);
  return result.violations == 0 ? 0 : 1;
}

}  // namespace

void add_soak(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<SoakWords>();
  Command command = line.command(
      "soak",
      "runs a protocol under faults, stops and kills at random moments, and checks what must hold",
      [&program, wanted] { return soak_protocol(program, *wanted); });
  command.option("protocol", wanted->protocol, "a protocol's file or name").required();
  command.option("arguments", wanted->request.what.arguments,
                 "name=value, with units: speed=0.5mm/s");
  command.option("--seeds", wanted->seeds, "how many (default: 100)").between(1, 1000000);
  command.option("--first", wanted->first,
                 "the first of them (default: 1): a campaign goes on there");
  command.option("--seed", wanted->seed, "only this one: it happens again as it did");
  command.option("--jobs", wanted->jobs, "processes at a time (default: one a core)")
      .between(1, 1000);
  command.flag("--slurm", wanted->slurm, "groups of seeds are tasks of an array job of Slurm");
  command.option("--tasks", wanted->tasks, "with --slurm: of the array, at most (default: 16)")
      .between(1, 1'000'000);
  command.option("--run-seed", wanted->run_seed, "of the simulated rig (default: 1)");
  command.option("--rig", wanted->request.where.rig_file,
                 "a rig's file or name (default: the protocol's own, else simulated)");
  command.option("--out", wanted->request.where.out,
                 "folder in which the records of bad seeds stay (default: runs)");
  command.flag("--json", wanted->json,
               "a JSON object a seed, and one at the end: {\"seeds\", \"violations\", ...}");
  command.examples({"vitreo soak hello_rig --seeds 20",
                    "vitreo soak hold --seeds 10000 --slurm --tasks 64 --out runs"});
}

}  // namespace vitreo::cli
