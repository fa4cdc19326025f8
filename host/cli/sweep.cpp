// `vitreo sweep`: a protocol over values of its parameters and over seeds, on the cores of this
// machine or on Slurm, with one table and one page at the end.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/config/config.h"
#include "host/files/run_folder.h"
#include "host/record/record_json.h"
#include "host/rig/registry.h"
#include "host/text/terminal_text.h"
#include "host/trials/point_bodies.h"
#include "host/trials/point_execution.h"
#include "host/trials/sweep_plan.h"
#include "host/trials/sweep_report.h"
#include "host/trials/sweep_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <optional>
#include <thread>
#include <unistd.h>

namespace vitreo::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFailuresShown = 10;

/// The words of the command, with the defaults that --help states.
struct SweepWords : ProtocolOptions {
  int repeats = 1;
  std::string seeds = "fresh";
  int random = 0;
  int latin = 0;
  int jobs = 0;  // 0: one a core
  int most = 10'000;
  int tasks = 16;
  std::string resume;
  std::string work;
  std::string shown;
  std::vector<std::string> sbatch;
  bool slurm = false;
  bool list = false;
  bool quiet = false;
  bool detach = false;
};

int cores() { return static_cast<int>(std::max(1U, std::thread::hardware_concurrency())); }

/// The words of --seeds.
SweepSeeds seeds_named(const std::string& word) {
  if (word == "fresh") return SweepSeeds::fresh;
  if (word == "paired") return SweepSeeds::paired;
  if (word == "same") return SweepSeeds::same;
  throw ConfigError("--seeds: wants fresh, paired or same; got " + word);
}

/// The words as a request; files are found as for `vitreo run`.
SweepRequest request_of(Program& program, SweepWords& wanted) {
  if (wanted.random > 0 && wanted.latin > 0)
    throw ConfigError("--random, --latin: are two ways to draw; give one of them");
  SweepRequest request;
  wanted.protocol = Program::protocol_file(wanted.protocol);
  request.run = wanted.complete(program);
  request.draws.kind = wanted.latin > 0 ? Draw::latin : Draw::random;
  request.draws.count = static_cast<std::size_t>(std::max(wanted.random, wanted.latin));
  request.draws.seed = request.run.how.seed;
  request.repeats = wanted.repeats;
  request.seeds = seeds_named(wanted.seeds);
  request.most = static_cast<std::uint64_t>(wanted.most);
  return request;
}

/// Where instruments are real there is one laboratory, and one run in it at a time. Whether they
/// are.
bool check_laboratory(Program& program, const std::string& rig, SweepWords& wanted) {
  if (!has_real_instruments(program.engine().load_rig(rig))) return false;
  if (wanted.slurm || wanted.jobs > 1)
    throw ConfigError(rig +
                      ": has real instruments, which one run at a time can use: --jobs 1, "
                      "and no --slurm");
  wanted.jobs = 1;
  return true;
}

/// How far it is, on the standard error: one line that is redrawn on a terminal; elsewhere a line
/// at each tenth, and for each point that did not complete.
class Progress {
 public:
  Progress(std::size_t points, bool quiet)
      : points_(points), quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0) {}
  ~Progress() { wipe(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void done(std::size_t count) {
    const std::size_t tenth = points_ == 0 ? 10 : 10 * count / points_;
    if (quiet_ || (!terminal_ && tenth == tenth_)) return;
    if (terminal_ && count == count_) return;
    fmt::print(stderr, "{}{} of {} points{}", terminal_ ? "\r" : "", count, points_,
               terminal_ ? "" : "\n");
    tenth_ = tenth, count_ = count, drawn_ = terminal_;
  }
  void note(const std::string& text) {
    wipe();
    if (!quiet_) fmt::print(stderr, "{}\n", for_terminal(text));
  }

 private:
  void wipe() {
    // To the begin of the line, and erase to its end (EL of ECMA-48).
    if (drawn_) fmt::print(stderr, "\r\x1b[K");
    drawn_ = false;
  }
  std::size_t points_;
  std::size_t count_ = 0;
  std::size_t tenth_ = 0;
  bool quiet_;
  bool terminal_;
  bool drawn_ = false;
};

RunnerEnd execute(Program& program, const PointFolder& folder, const SweepWords& wanted) {
  Progress progress(folder.points().size(), wanted.quiet);
  // What earlier calls have finished counts.
  std::size_t done = folder.points().size() - folder.unfinished().size();
  ExecuteOptions options;
  options.jobs = wanted.jobs > 0 ? wanted.jobs : cores();
  options.detach = wanted.detach;
  if (wanted.slurm)
    // This very program: a node may have another one of its name on the PATH.
    options.slurm =
        SlurmRequest{fs::read_symlink("/proc/self/exe").string(), wanted.tasks, wanted.sbatch};
  options.note = [&progress](const std::string& text) { progress.note(text); };
  options.finished = [&](std::size_t point, const nlohmann::json& result) {
    if (result.value("outcome", "") != "completed")
      progress.note(fmt::format("point {}: {}: {}", point, result.value("outcome", ""),
                                result.value("reason", "")));
    progress.done(++done);
  };
  return execute_points(folder, body_of(program.engine(), folder), options);
}

/// How many points had each.
std::map<std::string, int> outcomes_of(const SweepTable& table) {
  std::map<std::string, int> counts;
  const std::size_t column = table.column("outcome");
  for (const auto& row : table.rows) ++counts[text_in(row[column])];
  return counts;
}

/// The first of them; the report has more, the table all.
void print_failures(const SweepTable& table) {
  std::size_t failures = 0;
  for (const auto& row : table.rows) {
    const std::string outcome = text_in(row[table.column("outcome")]);
    if (outcome == "completed" || outcome == "missing" || ++failures > kFailuresShown) continue;
    fmt::print("point {}: {}: {}\n", text_in(row[table.column("point")]), outcome,
               for_terminal(text_in(row[table.column("reason")]), 200));
  }
  if (failures > kFailuresShown) fmt::print("... and {} more\n", failures - kFailuresShown);
}

/// Of what goes on elsewhere, or was told to stop; nothing where all that could be done is done.
std::optional<int> code_of(RunnerEnd end) {
  if (end == RunnerEnd::stopped) return static_cast<int>(ExitCode::stopped);
  if (end == RunnerEnd::handed_over) return static_cast<int>(ExitCode::completed);
  return std::nullopt;
}

/// 0: all completed, or Slurm goes on with them; 1: some did not; 3: told to stop; 5: points are
/// missing.
int code_of(const SweepTable& table, RunnerEnd end) {
  if (const auto code = code_of(end)) return *code;
  if (table.missing > 0) return static_cast<int>(ExitCode::internal);
  const auto counts = outcomes_of(table);
  const auto completed = counts.find("completed");
  const bool all =
      completed != counts.end() && static_cast<std::size_t>(completed->second) == table.rows.size();
  return static_cast<int>(all ? ExitCode::completed : ExitCode::script_error);
}

void print_summary(const SweepTable& table, const fs::path& folder, RunnerEnd end) {
  print_failures(table);
  std::string counts;
  for (const auto& [outcome, count] : outcomes_of(table))
    counts += fmt::format("{}{} {}", counts.empty() ? "" : ", ", count, outcome);
  fmt::print("{} points: {}\ntable: {}\nreport: {}\n", table.rows.size(), counts,
             (folder / "sweep.csv").string(), (folder / "report.html").string());
  if (table.missing > 0)
    fmt::print("{} are {}: vitreo sweep --resume {}\n", table.missing,
               end == RunnerEnd::handed_over ? "with Slurm, and collected by" : "missing",
               folder.string());
}

/// Table and page of what there is, whether it is all or not.
int conclude(const PointFolder& folder, const SweepWords& wanted, RunnerEnd end) {
  // Soaks and reproductions have no table: their own commands report.
  if (folder.head().value("kind", "") != "sweep")
    return code_of(end).value_or(end == RunnerEnd::all_done ? 0 : 5);
  const SweepTable table = read_table(folder);
  write_tables(table, folder);
  write_sweep_report(table, folder, wanted.shown);
  const int code = code_of(table, end);
  if (wanted.json)
    std::cout << dumped({{"sweep", folder.folder().string()},
                         {"points", table.rows.size()},
                         {"outcomes", outcomes_of(table)},
                         {"missing", table.missing},
                         {"exit_code", code}})
              << "\n";
  else
    print_summary(table, folder.folder(), end);
  return code;
}

// A task of the array: takes points until none is left, and says what became of them in its log.
int work_at(Program& program, const SweepWords& wanted) {
  const PointFolder folder(wanted.work);
  check_plan(program.engine(), folder);
  RunnerOptions options;
  // The script says how many cores the task was given.
  options.jobs = std::max(wanted.jobs, 1);
  options.offset = slurm_offset(folder.points().size());
  // A task that finds no point ends, and its cores are free for others.
  options.wait_for_others = false;
  options.note = [](const std::string& text) { fmt::print(stderr, "{}\n", text); };
  options.finished = [](std::size_t point, const nlohmann::json& result) {
    fmt::print("point {}: {}\n", point, result.value("outcome", ""));
    // At once: the log has it also when the task is killed.
    std::fflush(stdout);
  };
  const RunnerEnd end = run_points(folder, body_of(program.engine(), folder), options);
  // A point that failed is a row of the table and no failure of the task.
  return static_cast<int>(end == RunnerEnd::stopped ? ExitCode::stopped : ExitCode::completed);
}

// The plan says what is swept: values beside it would be read and ignored.
int resume(Program& program, SweepWords& wanted) {
  if (!wanted.protocol.empty() || !wanted.request.what.arguments.empty())
    throw ConfigError("--resume: the folder says what is swept; no protocol and no values with it");
  const PointFolder folder(wanted.resume);
  check_plan(program.engine(), folder);
  check_laboratory(program, folder.head().value("/rig/file"_json_pointer, "simulated"), wanted);
  return conclude(folder, wanted, execute(program, folder, wanted));
}

/// What would be done, without a folder.
int list_points(const PointPlan& plan, bool json) {
  for (const PlannedPoint& point : plan.points)
    std::cout << (json ? dumped({{"key", point.key}, {"what", point.what}})
                       : fmt::format("{}  seed {}  {}", point.key, dumped(point.what.at("seed")),
                                     dumped(point.what.at("values"))))
              << "\n";
  return 0;
}

int sweep(Program& program, SweepWords& wanted) {
  if (!wanted.work.empty()) return work_at(program, wanted);
  if (!wanted.resume.empty()) return resume(program, wanted);
  if (wanted.protocol.empty()) throw ConfigError("sweep: wants a protocol, or --resume FOLDER");
  const std::string out = wanted.request.where.out;
  wanted.request.where.out = out.empty() ? "sweeps" : out;
  SweepRequest request = request_of(program, wanted);
  // The runs lie in the sweep's own folder, and are of the laboratory's calibration all the same.
  if (check_laboratory(program, request.run.where.rig_file, wanted))
    request.run.where.calibrated_in = RunRequest::Where().out;
  // Before the folder is made: a mistake in the words leaves none behind.
  const PointPlan plan = plan_sweep(program.engine(), request);
  if (wanted.list) return list_points(plan, wanted.json);
  const fs::path place = out.empty()
                             ? make_run_folder("sweeps", fs::path(wanted.protocol).stem().string())
                             : fs::path(out);
  const PointFolder folder = PointFolder::create(place, plan);
  return conclude(folder, wanted, execute(program, folder, wanted));
}

void add_point_options(Command& command, SweepWords& wanted) {
  command.option("--repeat", wanted.repeats, "runs of each setting (default: 1)")
      .between(1, 1'000'000);
  command.option("--seed", wanted.request.how.seed,
                 "the first one, and of what is drawn (default: 1)");
  command.option("--seeds", wanted.seeds,
                 "fresh: each run has its own (default); paired: each setting has the same ones; "
                 "same: one for all");
  command.option("--random", wanted.random, "so many draws from the ranges without a count")
      .between(1, 100'000'000);
  command.option("--latin", wanted.latin, "the same as a Latin hypercube").between(1, 100'000'000);
  command.option("--most", wanted.most, "points that are taken at most (default: 10000)")
      .between(1, 100'000'000);
  command.flag("--list", wanted.list, "only list the points, and do nothing");
}

void add_place_options(Command& command, SweepWords& wanted) {
  command.option("--out", wanted.request.where.out,
                 "a new folder for the sweep (default: one in sweeps/)");
  command.option("--jobs", wanted.jobs, "runs at a time (default: one a core)").between(1, 10'000);
  command.option("--resume", wanted.resume, "goes on with the sweep in this folder");
  command.flag("--slurm", wanted.slurm, "the runs are tasks of an array job of Slurm");
  command.option("--tasks", wanted.tasks, "with --slurm: of the array, at most (default: 16)")
      .between(1, 1'000'000);
  command
      .option("--sbatch", wanted.sbatch,
              "with --slurm: an option of sbatch, such as --sbatch=--partition=long")
      .one_word_each();
  command.flag("--detach", wanted.detach, "with --slurm: does not wait; --resume collects");
  command.option("--work", wanted.work,
                 "what a task of the array does: takes points of this folder until none is left");
}

void add_run_words(Command& command, SweepWords& wanted) {
  command.option("--rig", wanted.request.where.rig_file,
                 "a rig's file or name (default: the protocol's own, else simulated)");
  command.option("--operator", wanted.request.how.operator_name, "who runs it, for the records");
  command.option("--fault", wanted.request.how.faults, "breaks a simulated instrument, as in run")
      .one_word_each();
  command
      .option("--answer", wanted.request.what.answers,
              "answers a question of the script: name=value")
      .one_word_each();
  command
      .option("--frames", wanted.request.what.frames,
              "cameras whose frames are recorded, as in run")
      .one_word_each()
      .delimiter(',');
  command.option("--show", wanted.shown,
                 "the result that the report begins with (default: the first that is stated)");
  command.flag("--json", wanted.json, "one JSON object at the end; of --list one a point");
  command.flag("--quiet,-q", wanted.quiet, "nothing but errors, and what there is at the end");
}

}  // namespace

void add_sweep(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<SweepWords>();
  // Empty means a new folder in sweeps/.
  wanted->request.where.out.clear();
  Command command = line.command(
      "sweep",
      "a protocol over values of its parameters, with a table and a page; 1 where a point failed",
      [&program, wanted] { return sweep(program, *wanted); });
  command.option("protocol", wanted->protocol, "a protocol's file or name");
  command.option("arguments", wanted->request.what.arguments,
                 "name=VALUES: 0.5mm/s; 0.1,0.5,2mm/s; 0.1..2mm/s:5 (:log); 0.1..2mm/s is drawn");
  add_point_options(command, *wanted);
  add_place_options(command, *wanted);
  add_run_words(command, *wanted);
  command.examples(
      {"vitreo sweep servo_square speed=0.1..2mm/s:5 law=pd,estimator --repeat 3",
       "vitreo sweep hold field=5..20mT speed=0.1..2mm/s:log --latin 40 --out sweeps/latin",
       "vitreo sweep hold speed=0.1..2mm/s:8 --slurm --sbatch=--partition=long",
       "vitreo sweep --resume sweeps/latin"});
}

}  // namespace vitreo::cli
