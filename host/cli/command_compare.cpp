// Command `vitreo compare A B C...`: what differs between runs, as tables and as a page.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/program.h"
#include "host/config/config.h"
#include "host/files/run_folder.h"
#include "host/record/record_json.h"
#include "host/runs/comparison.h"
#include "host/runs/run_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <iostream>

namespace vitreo::cli {
namespace {

struct CompareWords {
  std::vector<std::string> runs;
  std::string parent = "runs";
  std::string page = "comparison.html";
  bool json = false;
};

/// The cells as they are shown, the units of parameters in them.
nlohmann::json lines_json(const std::vector<ComparedLine>& lines) {
  nlohmann::json all = nlohmann::json::object();
  for (const ComparedLine& line : lines) all[line.name] = line.cells;
  return all;
}

/// SI, unlike the lines for people.
nlohmann::json results_of(const std::vector<RunData>& runs) {
  nlohmann::json all = nlohmann::json::array();
  for (const RunData& run : runs) {
    all.push_back(nlohmann::json::object());
    for (const StatedResult& one : run.results) all.back()[one.name] = one.value;
  }
  return all;
}

int compare(const CompareWords& wanted) {
  // Beyond that the columns of a page and the colors of a plot cannot be told apart.
  // In the words of the command line, before a record is read, which may take seconds.
  if (wanted.runs.size() < 2 || wanted.runs.size() > kMostCompared)
    throw ConfigError(
        fmt::format("compare: wants 2 to {} runs; got {}", kMostCompared, wanted.runs.size()));
  // All in memory at once: the page lays their samples over each other.
  std::vector<RunData> runs;
  // All are read before anything is written: one that cannot be read leaves no page behind.
  for (const std::string& word : wanted.runs)
    runs.push_back(read_run(find_run(word, wanted.parent)));
  write_file(wanted.page, comparison_html(runs));
  // The page is made in both cases; the standard output has text or JSON.
  if (!wanted.json) {
    std::cout << comparison_text(runs) << "page: " << wanted.page << "\n";
    return 0;
  }
  // By the folders' names: what is passed on has no paths of this machine.
  const RunComparison made = compare_runs(runs);
  nlohmann::json folders = nlohmann::json::array();
  for (const RunData& run : runs) folders.push_back(run.folder.filename().string());
  std::cout << dumped({{"runs", folders},
                       {"differing", lines_json(made.differing)},
                       {"same", made.same},
                       {"results", results_of(runs)},
                       {"page", wanted.page}})
            << "\n";
  return 0;
}

}  // namespace

void add_compare(CommandLine& line, Program&) {
  const auto wanted = std::make_shared<CompareWords>();
  Command command =
      line.command("compare", "what differs between runs, their results and streams in one page",
                   [wanted] { return compare(*wanted); });
  command
      .option("runs", wanted->runs, "two to eight runs: folders, names or their beginnings, last")
      .required();
  command.option("--runs", wanted->parent, "the folder in which the runs are (default: runs)");
  command.option("--page", wanted->page, "the page's file (default: comparison.html)");
  command.flag("--json", wanted->json, "one JSON document; results in SI units");
  command.examples({"vitreo compare 2026-11-21T1430 last",
                    "vitreo compare --runs sweeps/latin/runs A B C --page three.html"});
}

}  // namespace vitreo::cli
