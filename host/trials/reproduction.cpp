// SPDX-License-Identifier: Apache-2.0
#include "host/trials/reproduction.h"

#include "host/engine/versions.h"
#include "host/files/child_process.h"
#include "host/files/run_folder.h"
#include "host/record/thesis_verdict.h"
#include "host/text/columns.h"
#include "host/trials/point_execution.h"
#include "host/trials/silent_listener.h"
#include "host/trials/sweep_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

// Thesis and simulation are compared to their fourth digit.
constexpr int kQuantityDigits = 4;

/// What is done for one run of the plan, for its point. Paths below `root` and no names: a protocol
/// of that name in another place must not be taken instead.
nlohmann::json point_of(const ReproduceRequest& request, const PlannedRun& run) {
  const fs::path root = fs::absolute(request.root);
  const std::string& rig = request.laboratory ? run.laboratory : run.rig;
  const std::string& arguments = request.laboratory ? run.laboratory_arguments
                                 : request.brief    ? run.brief
                                                    : run.arguments;
  return {{"key", run.key},
          {"protocol", (root / "protocols" / (run.protocol + ".lua")).lexically_normal().string()},
          {"rig", (root / "scripts" / "rigs" / (rig + ".lua")).lexically_normal().string()},
          {"seed", run.seed},
          {"arguments", words_of(arguments)},
          {"laboratory", request.laboratory},
          {"out", fs::absolute(request.out).lexically_normal().string()}};
}

PointPlan reproduction_plan(const ReproduceRequest& request) {
  PointPlan plan{{{"kind", kReproductionKind}, {"versions", versions()}}, {}};
  for (const PlannedRun& run : request.runs) {
    nlohmann::json what = point_of(request, run);
    plan.points.push_back({point_key(what), std::move(what)});
  }
  return plan;
}

/// The reply of `run --json`, the last line: before it the instruments' addresses may stand.
nlohmann::json reply_in(std::string said) {
  while (!said.empty() && said.back() == '\n') said.pop_back();
  const std::size_t line = said.rfind('\n');
  return nlohmann::json::parse(line == std::string::npos ? said : said.substr(line + 1), nullptr,
                               false);
}

// "" where the key is missing or null.
std::string text_of(const nlohmann::json& row, const char* key) {
  const auto found = row.find(key);
  return found != row.end() && found->is_string() ? found->get<std::string>() : "";
}

/// The rows of a completed run, as scripts/analysis/expectations.lua wrote them. JSON has null
/// where Lua had NaN.
/// A run without a table of expectations is an error of the plan and gets a reason, unless the run
/// has one of its own already.
void read_rows(ReproducedRun& run) {
  std::ifstream file(fs::path(run.folder) / "expectations.json");
  const auto rows = nlohmann::json::parse(file, nullptr, false);
  if (rows.is_discarded() || !rows.is_array()) {
    run.reason = run.reason.empty() ? "it left no expectations" : run.reason;
    return;
  }
  for (const auto& row : rows) {
    ReproducedRow made;
    made.id = text_of(row, "id");
    made.what = text_of(row, "what");
    made.where = text_of(row, "where");
    made.unit = text_of(row, "unit");
    made.tolerance = text_of(row, "tolerance");
    made.verdict = text_of(row, "verdict");
    made.why = text_of(row, "why");
    const std::string reason = text_of(row, "reason");
    if (!reason.empty()) made.tolerance += " (" + reason + ")";
    if (row.contains("thesis") && row["thesis"].is_number())
      made.thesis = row["thesis"].get<double>();
    made.ours =
        row.contains("ours") && row["ours"].is_number() ? row["ours"].get<double>() : std::nan("");
    if (row.contains("deviation") && row["deviation"].is_number())
      made.deviation = row["deviation"].get<double>();
    if (row.contains("values") && row["values"].is_array())
      for (const auto& value : row["values"])
        if (value.is_number()) made.values.push_back(value.get<double>());
    made.protocol = run.plan.protocol;
    made.run = fs::path(run.folder).filename().string();
    run.rows.push_back(std::move(made));
  }
}

/// Among emulated instruments, behind real links: `vitreo emulate RIG -- vitreo run ... --json`.
/// The pipe is read to its end before the process is waited for: a child whose output fills the
/// pipe would never end. Reading stops when the child closes its standard output.
nlohmann::json run_in_laboratory(const nlohmann::json& what) {
  const std::string self = fs::read_symlink("/proc/self/exe").string();
  const std::string rig = what.at("rig");
  const std::string seed = std::to_string(what.at("seed").get<std::uint64_t>());
  std::vector<std::string> words{self, "emulate", rig, "--seed", seed, "--", self, "run"};
  for (const std::string& word : std::initializer_list<std::string>{
           what.at("protocol"), "--json", "--rig", rig, "--seed", seed, "--out", what.at("out")})
    words.push_back(word);
  for (const nlohmann::json& word : what.at("arguments")) words.push_back(word);
  ChildProcess child(words, ChildProcess::Pipe::from_output);
  std::string said;
  char part[4096];
  for (std::size_t got = 0; (got = child.read(part, sizeof part)) > 0;) said.append(part, got);
  const int code = child.finish();
  const nlohmann::json reply = reply_in(std::move(said));
  if (!reply.is_object())
    return {{"outcome", "failed"},
            {"reason", fmt::format("the program ended with {} and said nothing", code)}};
  if (reply.contains("error"))  // it did not come to a run
    return {{"outcome", "failed"}, {"reason", text_of(reply, "error")}};
  return {{"outcome", text_of(reply, "outcome")},
          {"reason", text_of(reply, "reason")},
          {"run", fs::path(text_of(reply, "run")).filename().string()},
          {"wall_time", reply.value("/results/wall_time"_json_pointer, 0.0)}};
}

/// The run of a point from its mark.
ReproducedRun reproduced(const PlannedRun& plan, const nlohmann::json& what,
                         const nlohmann::json& result) {
  // The words of a mark; read_rows() opens the run's own folder.
  ReproducedRun done;
  done.plan = plan;
  done.outcome = text_of(result, "outcome");
  if (done.outcome == "refused") done.outcome = "failed";  // it did not come to a run
  done.reason = text_of(result, "reason");
  const std::string run = text_of(result, "run");
  if (!run.empty()) done.folder = (fs::path(what.at("out").get<std::string>()) / run).string();
  done.wall_time = result.value("wall_time", 0.0);
  if (done.outcome == "completed") read_rows(done);
  return done;
}

/// For a cell of a table, in HTML or in Markdown.
/// Markdown tables break at "|" alone; HTML at its three characters. Texts come from scripts.
std::string escaped(const std::string& text, bool html) {
  std::string made;
  for (const char c : text) {
    if (html && c == '<')
      made += "&lt;";
    else if (html && c == '>')
      made += "&gt;";
    else if (html && c == '&')
      made += "&amp;";
    else if (!html && c == '|')
      made += "\\|";
    else
      made += c;
  }
  return made;
}

/// Each verdict by itself: a goal of this project that is met is no number of the thesis.
std::string summary(const std::vector<ReproducedRun>& runs) {
  VerdictCounts counts;
  int failed = 0;
  int all = 0;
  int unexplained = 0;
  for (const ReproducedRun& run : runs) {
    all += !run.plan.rig.empty();  // what is joined is no run
    failed += run.outcome != "completed" || !run.reason.empty();
    for (const ReproducedRow& row : run.rows) {
      counts.count(row.verdict);
      unexplained += row.verdict == to_string(ThesisVerdict::differs) && row.why.empty();
    }
  }
  return fmt::format("{}; of what differs {} is without a cause. {} of {} runs did not complete.",
                     counts.text(), unexplained, failed, all);
}

/// "differs, 4.1 spreads": with how far it is from the thesis, where that printed a spread.
std::string verdict_text(const ReproducedRow& row) {
  return row.verdict + (row.deviation ? fmt::format(", {:.1f} spreads", *row.deviation) : "");
}

// What is joined has no rig of its own (reproduction_joined.cpp) and is titled by its name.
std::string title_of(const ReproducedRun& run) {
  if (run.plan.rig.empty()) return run.plan.protocol;
  return fmt::format("{} (rig {}, seed {}{}{})", run.plan.protocol, run.plan.rig, run.plan.seed,
                     run.plan.arguments.empty() ? "" : ", ", run.plan.arguments);
}

/// Cells of a row that are compared.
struct Compared {
  std::string thesis;
  std::string ours;
  std::string laboratory;
  std::string tolerance;
};

/// Those of a run's rows: all of one dimension in one unit.
/// The cells of a whole run are converted at once, so that 0.9 mm and 137 µm of one table can be
/// compared by eye; four cells a row, in that order.
std::vector<Compared> compared(const std::vector<ReproducedRow>& rows) {
  std::vector<std::string> cells;
  for (const ReproducedRow& row : rows) {
    cells.push_back(row.thesis ? quantity_text(*row.thesis, row.unit) : "\u2013");
    cells.push_back(quantity_text(row.ours, row.unit));
    cells.push_back(row.laboratory ? quantity_text(*row.laboratory, row.unit) : "\u2013");
    cells.push_back(row.tolerance);
  }
  cells = cells_in_one_unit(std::move(cells));
  std::vector<Compared> shown;
  for (std::size_t i = 0; i + 3 < cells.size(); i += 4)
    shown.push_back({cells[i], cells[i + 1], cells[i + 2], cells[i + 3]});
  return shown;
}

/// For a cell of a table, with the units of scripts' texts in print.
std::string cell_text(const std::string& text, bool html) {
  return escaped(with_print_units(text), html);
}

// By its color: red, yellow for what differs with a cause, none for what is only shown.
const char* row_class(const ReproducedRow& row) {
  if (is_missed(row)) return "missed";
  const auto verdict = thesis_verdict_named(row.verdict);
  if (verdict == ThesisVerdict::differs) return "differs";
  return verdict == ThesisVerdict::shown ? "" : "well";
}

}  // namespace

std::string quantity_text(double value, const std::string& unit) {
  return std::isfinite(value) ? format_quantity(value, unit, kQuantityDigits) : "none";
}

bool is_missed(const ReproducedRow& row) {
  const auto verdict = thesis_verdict_named(row.verdict);
  if (verdict == ThesisVerdict::differs) return row.why.empty();
  return !verdict || verdict == ThesisVerdict::goal_missed;
}

// Keys are sorted; entries with `joins` are read_joined()'s.
// reader.finish() refuses a key that is not known, so a misspelt "argumnets" is not a run with the
// defaults.
std::vector<PlannedRun> read_plan(const RigDescription& file) {
  std::vector<PlannedRun> runs;
  ConfigReader reader(file);
  for (const std::string& key : reader.keys()) {
    // A table a run. Its name goes into the key of the point.
    ConfigReader one = reader.table(key);
    if (one.has("joins")) continue;
    PlannedRun run;
    run.key = key;
    run.protocol = one.text("protocol", "");
    if (run.protocol.empty()) one.fail("protocol", "must be given");
    run.rig = one.text("rig", "simulated");
    run.arguments = one.text("arguments", "");
    run.brief = one.text("brief", "-");
    run.laboratory = one.text("laboratory", "");
    run.laboratory_arguments = one.text("laboratory_arguments", "");
    run.seed = static_cast<std::uint64_t>(one.integer("seed", 1, 0, 1000000000));
    one.finish();
    runs.push_back(std::move(run));
  }
  reader.finish();
  return runs;
}

nlohmann::json run_reproduction_point(ScriptEngine& engine, const nlohmann::json& what) {
  if (what.at("laboratory").get<bool>()) return run_in_laboratory(what);
  RunRequest request;
  request.what.protocol_file = what.at("protocol");
  request.what.arguments = what.at("arguments").get<std::vector<std::string>>();
  request.where.rig_file = what.at("rig");
  request.where.out = what.at("out");
  request.how.seed = what.at("seed").get<std::uint64_t>();
  return run_request_point(engine, request);
}

// The marks are of use only until all is done: the runs' own folders say everything afterwards.
std::vector<ReproducedRun> reproduce(ScriptEngine& engine, const ReproduceRequest& request,
                                     const std::function<void(const ReproducedRun&)>& report) {
  const PointFolder folder = request.resume.empty()
                                 ? PointFolder::create(make_run_folder(request.out, "reproduction"),
                                                       reproduction_plan(request))
                                 : PointFolder(request.resume);
  // Compared by the keys: --resume with other options would mix two reproductions.
  const PointPlan wanted = reproduction_plan(request);
  for (std::size_t i = 0; i < wanted.points.size(); ++i)
    if (folder.points().size() != wanted.points.size() ||
        folder.points()[i].key != wanted.points[i].key)
      throw SweepError(folder.folder().string() + ": is not of these runs, and cannot go on");
  const auto run_of = [&](std::size_t point, const nlohmann::json& result) {
    return reproduced(request.runs[point], folder.points()[point].what, result);
  };
  ExecuteOptions options;
  options.jobs = std::max(request.processes, 1);
  options.slurm = request.slurm;
  options.finished = [&](std::size_t point, const nlohmann::json& result) {
    report(run_of(point, result));
  };
  const PointBody body = [&engine](const PlannedPoint& planned, std::size_t, const SayLine&) {
    return run_reproduction_point(engine, planned.what);
  };
  if (execute_points(folder, body, options) != RunnerEnd::all_done)
    throw std::runtime_error("not all runs are done; vitreo reproduce --resume " +
                             folder.folder().string() + " goes on");
  std::vector<ReproducedRun> done;
  for (std::size_t i = 0; i < request.runs.size(); ++i)
    done.push_back(run_of(i, folder.result(i).value()));
  fs::remove_all(folder.folder());
  return done;
}

// JSON has no NaN: a number without an answer is null.
nlohmann::json to_json(const ReproducedRow& row) {
  nlohmann::json json = {{"id", row.id},     {"what", row.what},           {"where", row.where},
                         {"unit", row.unit}, {"tolerance", row.tolerance}, {"verdict", row.verdict},
                         {"why", row.why},   {"protocol", row.protocol},   {"run", row.run}};
  json["thesis"] = row.thesis ? nlohmann::json(*row.thesis) : nlohmann::json();
  json["ours"] = std::isfinite(row.ours) ? nlohmann::json(row.ours) : nlohmann::json();
  json["deviation"] = row.deviation ? nlohmann::json(*row.deviation) : nlohmann::json();
  return json;
}

// No date and no machine: the page changes in the repository only where a number does.
std::string reproduction_markdown(const std::vector<ReproducedRun>& runs) {
  std::string text =
      "# The thesis, reproduced\n\nWritten by `vitreo reproduce`, not by hand: each number of the "
      "thesis that a "
      "protocol can measure on the simulated laboratory, ours beside it, with the measure, the "
      "verdict, and why "
      "where "
      "we differ ([what the words mean](protocols.md#verdicts)); of some the same protocol on the "
      "emulated laboratory, behind real links "
      "(`vitreo reproduce --laboratory`, shorter where the plan says so). Seeds and all settings "
      "are in the runs' records; `scripts/reproduction.lua` is "
      "the plan.\n\n" +
      summary(runs) + "\n";
  for (const ReproducedRun& run : runs) {
    text += fmt::format("\n## {}\n\n", title_of(run));
    if (!run.reason.empty())
      text += fmt::format("{}: {}\n\n", run.outcome, escaped(run.reason, false));
    if (run.rows.empty()) continue;
    text +=
        "| where | what | thesis | ours | emulated laboratory | measure | verdict | why "
        "|\n|---|---|---|---|---|---|---|---|\n";
    const std::vector<Compared> cells = compared(run.rows);
    for (std::size_t i = 0; i < run.rows.size(); ++i) {
      const ReproducedRow& row = run.rows[i];
      text += fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} |\n",
                          cell_text(row.where, false), cell_text(row.what, false), cells[i].thesis,
                          cells[i].ours, cells[i].laboratory, cell_text(cells[i].tolerance, false),
                          is_missed(row) ? "**" + verdict_text(row) + "**" : verdict_text(row),
                          cell_text(row.why, false));
    }
  }
  return text;
}

// Links are relative to the page, so that the folder can be moved as a whole. Unclosed cells are
// valid HTML.
std::string reproduction_page(const std::vector<ReproducedRun>& runs, const fs::path& beside) {
  std::string text =
      "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>The thesis, "
      "reproduced</title>\n<style>body{font:"
      "15px/1.4 sans-serif;margin:2em;max-width:75em}table{border-collapse:collapse;margin:.5em "
      "0}td,th{border:1px "
      "solid "
      "#ccc;padding:.2em "
      ".5em;text-align:left;vertical-align:top}.missed{background:#fdd}.differs{background:#ffc}."
      "well{background:#dfd}</"
      "style>\n"
      "<h1>The thesis, reproduced</h1>\n<p>" +
      summary(runs) + "</p>\n";
  for (const ReproducedRun& run : runs) {
    text += fmt::format("<h2>{}</h2>\n", escaped(title_of(run), true));
    if (!run.reason.empty())
      text += fmt::format("<p>{}: {}</p>\n", run.outcome, escaped(run.reason, true));
    if (!run.folder.empty())
      text += fmt::format(
          "<p><a href=\"{}\">the run's report</a>, {:.1f} s</p>\n",
          escaped(fs::relative(fs::path(run.folder) / "report.html", beside).string(), true),
          run.wall_time);
    if (run.rows.empty()) continue;
    text +=
        "<table><tr><th>where<th>what<th>thesis<th>ours<th>emulated "
        "laboratory<th>measure<th>verdict<th>why</tr>\n";
    const std::vector<Compared> cells = compared(run.rows);
    for (std::size_t i = 0; i < run.rows.size(); ++i) {
      const ReproducedRow& row = run.rows[i];
      text += fmt::format(
          "<tr class=\"{}\"><td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>\n",
          row_class(row), cell_text(row.where, true), cell_text(row.what, true), cells[i].thesis,
          cells[i].ours, cells[i].laboratory, cell_text(cells[i].tolerance, true),
          verdict_text(row), cell_text(row.why, true));
    }
    text += "</table>\n";
  }
  return text + "</html>\n";
}

}  // namespace vitreo
