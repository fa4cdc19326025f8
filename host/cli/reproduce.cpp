// `vitreo reproduce`: every protocol that has numbers of the thesis, and a page of the two side by
// side.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/files/run_folder.h"
#include "host/record/record_json.h"
#include "host/trials/reproduction.h"
#include "host/trials/reproduction_joined.h"
#include "host/trials/reproduction_laboratory.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <thread>

namespace vitreo::cli {
namespace {

namespace fs = std::filesystem;

struct ReproductionWords {
  std::vector<std::string> only;
  std::string out = "runs";
  std::string docs;
  std::string plan;
  int processes = 0;  // 0: one a core
  bool json = false;
  bool brief = false;
  bool laboratory = false;
  bool slurm = false;
  int tasks = 16;
  std::string resume;
};

/// The runs of the plan that were asked for; the short form leaves some out.
/// A misspelt protocol is refused before the first run begins. "-" as the short form's arguments
/// means that the run has no short form.
std::vector<PlannedRun> chosen(const RigDescription& plan, const ReproductionWords& wanted) {
  const std::string& file = plan.file;
  std::vector<PlannedRun> all = read_plan(plan);
  std::vector<PlannedRun> runs;
  std::vector<std::string> known;
  for (const PlannedRun& run : all) known.push_back(run.protocol);
  for (const std::string& name : wanted.only)
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      const std::string near = nearest(name, known);
      throw ConfigError(fmt::format("reproduce: {} is not in {}{}", name, file,
                                    near.empty() ? "" : "; did you mean " + near + "?"));
    }
  for (PlannedRun& run : all) {
    const bool asked = wanted.only.empty() || std::find(wanted.only.begin(), wanted.only.end(),
                                                        run.protocol) != wanted.only.end();
    if (asked && !(wanted.brief && run.brief == "-")) runs.push_back(std::move(run));
  }
  return runs;
}

// On the standard error, a line as each run ends, for the standard output is the table's.
void report(const ReproducedRun& run) {
  int missed = 0;
  for (const ReproducedRow& row : run.rows) missed += is_missed(row);
  fmt::print(stderr, "{:<26} {:<10} {:5.1f} s  {} numbers, {} missed{}{}\n", run.plan.protocol,
             run.outcome, run.wall_time, run.rows.size(), missed, run.reason.empty() ? "" : ": ",
             run.reason);
}

constexpr const char* kLaboratoryFile = "reproduction_laboratory.json";

/// Behind real links, one after the other, for they keep real time. The numbers are the page's
/// column from then on.
int measure_laboratory(Program& program, ReproduceRequest request, const fs::path& docs) {
  request.runs = laboratory_runs(request.runs);
  if (request.runs.empty())
    throw ConfigError("reproduce: none of these can run on the emulated laboratory");
  request.laboratory = true;
  request.processes = 1;
  request.slurm.reset();
  const std::vector<ReproducedRun> runs = reproduce(program.engine(), request, report);
  keep_laboratory(runs, docs / kLaboratoryFile);
  fmt::print("written: {}\n", (docs / kLaboratoryFile).string());
  return std::all_of(runs.begin(), runs.end(),
                     [](const ReproducedRun& run) { return run.outcome == "completed"; })
             ? 0
             : 1;
}

// Each run is a process of its own: the state of one run cannot leak into the next, and the cores
// are used. The page in docs/ is written over only by the whole plan with its own settings.
int reproduce_thesis(Program& program, const ReproductionWords& wanted) {
  const RigDescription plan = program.engine().load_rig(
      wanted.plan.empty() ? Program::in_data_folder("scripts/reproduction.lua") : wanted.plan);
  const std::vector<JoinedRow> joined = read_joined(plan);
  ReproduceRequest request;
  request.runs = chosen(plan, wanted);
  request.resume = wanted.resume;
  if (wanted.slurm)
    request.slurm = SlurmRequest{fs::read_symlink("/proc/self/exe").string(), wanted.tasks, {}};
  request.root = Program::in_data_folder(".");
  request.out = wanted.out;
  request.brief = wanted.brief;
  const int cores = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  request.processes = wanted.processes > 0 ? wanted.processes : cores;
  const fs::path docs =
      wanted.docs.empty() ? fs::path(Program::in_data_folder("docs")) : fs::path(wanted.docs);
  // Before minutes of runs: a folder that cannot be made is told now.
  fs::create_directories(docs);
  if (wanted.laboratory) return measure_laboratory(program, std::move(request), docs);
  std::vector<ReproducedRun> runs = reproduce(program.engine(), request, report);
  join_laboratory(runs, docs / kLaboratoryFile);
  // Rows about several runs are missing by nature where only a part was run, so they count as
  // missed only for the whole plan.
  ReproducedRun together = join_rows(joined, runs, wanted.only.empty() && !wanted.brief);
  if (!together.rows.empty()) runs.push_back(std::move(together));
  fs::create_directories(request.out);
  // A part of the plan, or its short form, is no reason to write over the page about the whole.
  const bool whole = wanted.only.empty() && !wanted.brief && wanted.plan.empty();
  const fs::path text = docs / "reproduction.md";
  const fs::path page = request.out / "reproduction.html";
  if (whole || !wanted.docs.empty()) write_file(text, reproduction_markdown(runs));
  write_file(page, reproduction_page(runs, request.out));
  bool well = true;
  nlohmann::json rows = nlohmann::json::array();
  // The exit code is 1 for a number that is missed as well as for a run that did not
  // complete, so that the whole can serve as a test.
  for (const ReproducedRun& run : runs) {
    well = well && run.outcome == "completed" && run.reason.empty();
    for (const ReproducedRow& row : run.rows) {
      well = well && !is_missed(row);
      rows.push_back(to_json(row));
    }
  }
  if (wanted.json)
    std::cout << dumped(rows) << "\n";
  else
    fmt::print("{}page: {}\n",
               whole || !wanted.docs.empty() ? "written: " + text.string() + "\n" : "",
               page.string());
  return well ? 0 : 1;
}

}  // namespace

void add_reproduce(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<ReproductionWords>();
  Command command = line.command(
      "reproduce", "the thesis' experiments, its numbers beside ours; 1 where one is missed",
      [&program, wanted] { return reproduce_thesis(program, *wanted); });
  command.option("only", wanted->only, "protocols of the plan (default: all)");
  command.flag("--json", wanted->json,
               "a row for each number: id, thesis, ours, unit, tolerance, verdict, deviation, why");
  command.flag("--brief", wanted->brief, "the short form of each run, to see that all of it works");
  command.flag("--laboratory", wanted->laboratory,
               "those that can on the emulated laboratory, in real time, for the page's column");
  command.option("--processes", wanted->processes, "runs at a time (default: one a core)")
      .between(1, 1000);
  command.flag("--slurm", wanted->slurm, "the runs are tasks of an array job of Slurm");
  command.option("--tasks", wanted->tasks, "with --slurm: of the array, at most (default: 16)")
      .between(1, 1'000'000);
  command.option("--resume", wanted->resume,
                 "goes on with one that was cut short: the folder that it named");
  command.option("--out", wanted->out, "folder for the runs' folders and the page (default: runs)");
  command.option(
      "--docs", wanted->docs,
      "folder for reproduction.md (default: docs/ beside protocols/, of the whole plan)");
  command.option("--plan", wanted->plan, "another plan than scripts/reproduction.lua");
  command.examples({"vitreo reproduce", "vitreo reproduce sensitivity_focus --json"});
}

}  // namespace vitreo::cli
