// Reproduction of the thesis: which runs, in which processes, and our numbers beside the printed
// ones. Each protocol leaves its rows in expectations.json (scripts/analysis/expectations.lua);
// here they are collected and shown.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"
#include "host/session/script_engine.h"
#include "host/trials/sweep_slurm.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// One run of the plan.
struct PlannedRun {
  std::string key;                   // runs are started and shown in the order of their keys
  std::string protocol;              // a name in protocols/
  std::string rig;                   // a name in scripts/rigs/
  std::string arguments;             // as on the command line, blanks between
  std::string brief;                 // the same for the short form; "-": left out there
  std::string laboratory;            // a rig of real drivers for the emulated laboratory; or ""
  std::string laboratory_arguments;  // there
  std::uint64_t seed = 1;
};

/// A plan is a Lua table of constants: key = { protocol =, rig =, arguments =, brief =, seed = };
/// entries that join rows (host/trials/reproduction_joined.h) are passed over. Throws ConfigError.
std::vector<PlannedRun> read_plan(const RigDescription& file);

/// One number beside the thesis'. SI.
struct ReproducedRow {
  std::string id;
  std::string what;
  std::string where;  // table or figure of the thesis
  std::string unit;
  std::string tolerance;  // what it is judged by
  std::string verdict;    // host/record/thesis_verdict.h
  std::string why;
  std::string protocol;
  std::string run;
  std::optional<double> thesis;
  double ours = 0;
  std::optional<double> laboratory{};  // the same, run behind real links
  std::optional<double> deviation{};   // from the thesis, in the spread that it prints
  std::vector<double> values{};  // of which `ours` is the median, where the protocol states them
};

struct ReproducedRun {
  PlannedRun plan;
  // As the run itself reports.
  std::string outcome;
  std::string reason;
  std::string folder;
  double wall_time = 0;  // s
  std::vector<ReproducedRow> rows;
};

struct ReproduceRequest {
  std::vector<PlannedRun> runs;
  std::string root;                // where protocols/ and scripts/ are
  std::filesystem::path out;       // the folder for the runs' folders
  std::filesystem::path resume{};  // the folder of the marks of one that was cut short
  std::optional<SlurmRequest> slurm{};
  int processes = 1;        // at a time, without Slurm
  bool brief = false;       // the short form of each
  bool laboratory = false;  // each on its `laboratory`, behind real links, in real time
};

/// Runs them all, as the points of a plan (host/trials/point_folder.h); `report` is called as each
/// ends. A run that failed has its reason and no rows. Throws std::runtime_error where not all
/// could be done: it names the folder with which to go on.
std::vector<ReproducedRun> reproduce(ScriptEngine& engine, const ReproduceRequest& request,
                                     const std::function<void(const ReproducedRun&)>& report);

/// The run at a point of such a plan.
constexpr const char* kReproductionKind = "reproduction";
nlohmann::json run_reproduction_point(ScriptEngine& engine, const nlohmann::json& what);

/// A goal that was missed, a number that differs from the thesis without a cause, or no verdict.
bool is_missed(const ReproducedRow& row);
/// For people, to four digits in the display unit: "137 µm"; "none" for what is no number.
std::string quantity_text(double value, const std::string& unit);
nlohmann::json to_json(const ReproducedRow& row);
/// The whole as a page for docs/ (Markdown) and as one to look at, with links to the runs' reports.
std::string reproduction_markdown(const std::vector<ReproducedRun>& runs);
std::string reproduction_page(const std::vector<ReproducedRun>& runs,
                              const std::filesystem::path& beside);

}  // namespace vitreo
