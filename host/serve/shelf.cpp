// SPDX-License-Identifier: Apache-2.0
#include "host/serve/shelf.h"

#include "host/config/config.h"
#include "host/files/posix_file.h"
#include "host/runs/catalog.h"
#include "host/runs/comparison.h"
#include "host/runs/run_outline.h"
#include "host/runs/run_reader.h"
#include "host/text/columns.h"
#include "host/text/units.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <iterator>
#include <set>
#include <sstream>

namespace vitreo::serve {

namespace fs = std::filesystem;

namespace {

constexpr std::uintmax_t kLargestFile = 64U << 20;
constexpr std::size_t kMostPages = 8;  // comparisons that are kept
constexpr std::size_t kMostColumns = 12;
constexpr std::size_t kMostSweeps = 500;

/// A folder's name as make_run_folder() and the sweeps have them: no path leads out of it.
bool is_name(const std::string& name) {
  return !name.empty() && name.size() < 200 && name[0] != '.' &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) {
           return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.' || c == '+';
         });
}

// No name of a protocol or a person has such a sign.
bool is_condition(const std::string& text) {
  return text.find_first_of("<>=~") != std::string::npos;
}

/// Words that stand in the run, each somewhere.
// Each word narrows: "gel anna" are her runs in gels.
std::string condition_of_words(const std::string& text) {
  std::istringstream words(text);
  std::vector<std::string> parts;
  for (std::string word; words >> word;) {
    if (word.find('"') != std::string::npos)
      throw ConfigError("search: wants words without quotes, or a condition: speed > 0.5mm/s");
    parts.push_back(fmt::format(
        "(text ~ \"{0}\" or protocol ~ \"{0}\" or title ~ \"{0}\" or operator ~ \"{0}\")", word));
  }
  return fmt::format("{}", fmt::join(parts, " and "));
}

/// The names that a condition compares: what stands before a sign, but no field of the run itself.
// What a person asks for is what he wants to see: the column appears by itself.
std::vector<std::string> names_in(const std::string& condition) {
  static const std::set<std::string> kFields{
      "run",    "time", "protocol", "title",    "operator",        "seed",    "outcome",
      "reason", "rig",  "text",     "ended_by", "experiment_time", "version", "wall_time"};
  std::vector<std::string> names;
  for (std::size_t at = condition.find_first_of("<>=~!"); at != std::string::npos;
       at = condition.find_first_of("<>=~!", at + 1)) {
    std::size_t end = at;
    while (end > 0 && condition[end - 1] == ' ') --end;
    std::size_t begin = end;
    while (begin > 0 && (std::isalnum(static_cast<unsigned char>(condition[begin - 1])) != 0 ||
                         condition[begin - 1] == '_' || condition[begin - 1] == '.'))
      --begin;
    const std::string name = condition.substr(begin, end - begin);
    if (name.empty() || kFields.contains(name)) continue;
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  }
  return names;
}

/// The column's cells as people read them, in one unit.
// One unit a column, so that values can be compared by eye.
std::vector<std::string> cells_of(const std::vector<CatalogRow>& rows, std::size_t column) {
  std::vector<double> numbers;
  std::string unit;
  for (const CatalogRow& row : rows) {
    const auto& value = row.columns[column];
    if (!value || !value->number || !value->text.empty()) continue;
    numbers.push_back(*value->number);
    unit = value->unit;
  }
  const ShownColumn shown = show_column(numbers, unit);
  std::vector<std::string> cells;
  std::size_t next = 0;
  for (const CatalogRow& row : rows) {
    const auto& value = row.columns[column];
    if (!value)
      cells.emplace_back("");
    else if (value->number && value->text.empty())
      cells.push_back(with_unit({shown.numbers[next++], shown.unit}));
    else
      cells.push_back(value->text);
  }
  return cells;
}

// Names of files without their folders, which are of this machine.
nlohmann::json json_of(const RunHead& head) {
  return {{"run", fs::path(head.folder).filename().string()},
          {"time", head.time},
          {"protocol", fs::path(head.protocol).stem().string()},
          {"title", head.title},
          {"operator", head.operator_name},
          {"seed", head.seed},
          {"rig", fs::path(head.rig).stem().string()},
          {"outcome", head.state},
          {"reason", head.reason},
          {"experiment_time", head.experiment_time},
          {"duration", format_quantity(head.experiment_time, "s")}};
}

nlohmann::json json_of(const NamedValue& value) {
  // A flag has both a text and a number; the text is what people read.
  std::string shown = value.text;
  if (shown.empty() && value.number) shown = format_quantity(*value.number, value.unit);
  // As it can be typed into a form again.
  const std::string typed = value.text.empty() && value.number
                                ? plain_quantity(*value.number, value.unit, 9)
                                : value.text;
  return {{"name", value.name}, {"shown", shown}, {"typed", typed}};
}

nlohmann::json lines_of(const std::vector<ComparedLine>& lines) {
  nlohmann::json all = nlohmann::json::array();
  for (const ComparedLine& line : lines)
    all.push_back({{"name", line.name}, {"cells", line.cells}, {"difference", line.difference}});
  return all;
}

/// First what a reader looks for: the first result that differs, of each run. It never says better:
/// one run each has no spread.
std::string sentence_of(const RunComparison& made) {
  if (made.results.empty()) return "No results are stated.";
  const auto differs =
      std::find_if(made.results.begin(), made.results.end(), [](const ComparedLine& line) {
        return std::any_of(line.cells.begin(), line.cells.end(),
                           [&line](const std::string& cell) { return cell != line.cells[0]; });
      });
  const ComparedLine& first = differs == made.results.end() ? made.results.front() : *differs;
  std::string text = first.name + ": ";
  for (std::size_t i = 0; i < made.names.size(); ++i)
    text += fmt::format("{}{} in {}", i == 0 ? "" : ", ", first.cells[i], made.names[i]);
  return text + ".";
}

/// By the file's ending; nothing else is shown in a browser, but saved.
// An ending that is not in the table is saved by the browser and never opened in it.
std::string type_of(const fs::path& file) {
  static const std::map<std::string, std::string> kTypes{{".html", "text/html; charset=utf-8"},
                                                         {".svg", "image/svg+xml"},
                                                         {".png", "image/png"},
                                                         {".jpg", "image/jpeg"},
                                                         {".csv", "text/csv; charset=utf-8"},
                                                         {".json", "application/json"},
                                                         {".md", "text/plain; charset=utf-8"},
                                                         {".txt", "text/plain; charset=utf-8"},
                                                         {".lua", "text/plain; charset=utf-8"}};
  const auto found = kTypes.find(file.extension().string());
  return found == kTypes.end() ? "application/octet-stream" : found->second;
}

}  // namespace

// An origin of its own (CSP sandbox, level 3, 6.3): a report may have come from another laboratory,
// and its scripts must reach neither our cookie nor our interface.
view::WebReply sandboxed(std::string html, const std::string& type) {
  return {200,
          std::move(html),
          type,
          {{"Content-Security-Policy",
            "sandbox allow-scripts allow-downloads allow-popups; default-src 'none'; style-src "
            "'unsafe-inline'; script-src 'unsafe-inline'; img-src data: 'self'; font-src data:; "
            "frame-ancestors 'self'"}}};
}

Shelf::Shelf(fs::path runs, fs::path sweeps) : runs_(std::move(runs)), sweeps_(std::move(sweeps)) {}

nlohmann::json Shelf::runs(const std::string& find, const std::vector<std::string>& columns,
                           std::size_t skip, std::size_t most) {
  CatalogRequest request;
  std::error_code none;
  // Before the first run there is no folder; that is no error.
  if (!fs::is_directory(runs_, none))
    return {{"total", 0}, {"columns", nlohmann::json::array()}, {"runs", nlohmann::json::array()}};
  request.where = is_condition(find) ? find : condition_of_words(find);
  if (is_condition(find)) request.columns = names_in(find);
  for (const std::string& name : columns)
    if (std::find(request.columns.begin(), request.columns.end(), name) == request.columns.end())
      request.columns.push_back(name);
  if (request.columns.size() > kMostColumns)
    throw ConfigError(fmt::format("columns: at most {}", kMostColumns));
  Catalog catalog(runs_);
  std::vector<CatalogRow> rows = catalog.find(request);
  // Counted before the page is cut out of it. The catalog gives the oldest first.
  const std::size_t total = rows.size();
  std::reverse(rows.begin(), rows.end());
  rows.erase(rows.begin(), rows.begin() + static_cast<std::ptrdiff_t>(std::min(skip, total)));
  if (rows.size() > most) rows.resize(most);
  nlohmann::json list = nlohmann::json::array();
  for (const CatalogRow& row : rows) {
    list.push_back(json_of(row.head));
    list.back()["values"] = nlohmann::json::array();
  }
  for (std::size_t i = 0; i < request.columns.size(); ++i) {
    const std::vector<std::string> cells = cells_of(rows, i);
    for (std::size_t k = 0; k < rows.size(); ++k) list[k]["values"].push_back(cells[k]);
  }
  return {{"total", total}, {"columns", request.columns}, {"runs", list}};
}

// A name, checked letter by letter: no part of a request is ever joined to a path unchecked.
fs::path Shelf::run_folder(const std::string& name) const {
  std::error_code none;
  if (!is_name(name) || !fs::is_directory(runs_ / name, none))
    throw ConfigError("there is no run '" + name.substr(0, 80) + "'");
  return runs_ / name;
}

nlohmann::json Shelf::run(const std::string& name) {
  const fs::path folder = run_folder(name);
  // Without samples and pictures: a run of a night opens as quickly as one of a second.
  const RunSummary summary = read_summary(folder);
  nlohmann::json json = json_of(summary.head);
  static const std::map<char, std::string> kKinds{
      {'p', "parameters"}, {'r', "results"}, {'t', "tags"}, {'s', "sample"}};
  for (const auto& [kind, key] : kKinds) json[key] = nlohmann::json::array();
  for (const NamedValue& value : summary.values)
    if (kKinds.contains(value.kind)) json[kKinds.at(value.kind)].push_back(json_of(value));
  std::error_code none;
  json["report"] = fs::exists(folder / "report.html", none);
  return json;
}

nlohmann::json Shelf::compare(const std::vector<std::string>& names) {
  std::vector<RunData> runs;
  if (names.size() < 2 || names.size() > kMostCompared)
    throw ConfigError(
        fmt::format("compare: wants 2 to {} runs; got {}", kMostCompared, names.size()));
  // Samples are wanted by the plots alone, which are a page of their own.
  for (const std::string& name : names) runs.push_back(read_outline(run_folder(name)));
  const RunComparison made = compare_runs(runs);
  nlohmann::json heads = nlohmann::json::array();
  for (const RunData& run : runs)
    heads.push_back({{"run", run.folder.filename().string()},
                     {"title", run.start.protocol_title},
                     {"time", run.start.t0_utc_ns.value_or(0) / 1'000'000'000}});
  return {{"names", made.names},
          {"runs", heads},
          {"sentence", sentence_of(made)},
          {"differing", lines_of(made.differing)},
          {"same", made.same},
          {"results", lines_of(made.results)}};
}

// A page of two closed runs stays as it is; of runs that go on it is not kept.
std::string Shelf::comparison_page(const std::vector<std::string>& names) {
  const std::string key = fmt::format("{}", fmt::join(names, ","));
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = pages_.find(key); found != pages_.end()) return found->second;
  }
  if (names.size() < 2 || names.size() > kMostCompared)
    throw ConfigError(
        fmt::format("compare: wants 2 to {} runs; got {}", kMostCompared, names.size()));
  std::vector<RunData> runs;
  for (const std::string& name : names) runs.push_back(read_run(run_folder(name)));
  std::string page = comparison_html(runs);
  const bool closed =
      std::all_of(runs.begin(), runs.end(), [](const RunData& run) { return run.end.has_value(); });
  const std::lock_guard lock(mutex_);
  if (pages_.size() >= kMostPages) pages_.clear();
  if (closed) pages_[key] = page;
  return page;
}

nlohmann::json Shelf::sweeps() const {
  std::vector<std::pair<fs::file_time_type, fs::path>> folders;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(sweeps_, none))
    if (fs::exists(entry.path() / "plan.json", none))
      folders.emplace_back(fs::last_write_time(entry.path() / "plan.json", none), entry.path());
  // By the plan, which is written once: reading a sweep does not make it newer.
  std::sort(folders.rbegin(), folders.rend());
  if (folders.size() > kMostSweeps) folders.resize(kMostSweeps);
  nlohmann::json list = nlohmann::json::array();
  for (const auto& [time, folder] : folders) {
    const auto plan = nlohmann::json::parse(read_whole_file(folder / "plan.json"), nullptr, false);
    list.push_back(
        {{"name", folder.filename().string()},
         {"report", fs::exists(folder / "report.html", none)},
         {"csv", fs::exists(folder / "sweep.csv", none)},
         {"points", plan.is_object() ? plan.value("points", 0) : 0},
         {"protocol",
          plan.is_object() ? plan.value("/protocol/name"_json_pointer, std::string()) : ""}});
  }
  return list;
}

// Each part of the path is a plain name, and the file is opened without following a link.
view::WebReply Shelf::file(const std::string& path) const {
  const view::WebReply missing{404, R"({"error":"there is no such file"})"};
  fs::path file;
  std::size_t begin = 1;
  for (int part = 0; begin <= path.size(); ++part) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    const std::string name = path.substr(begin, end - begin);
    if (!is_name(name)) return missing;
    if (part == 0 && name != "runs" && name != "sweeps") return missing;
    file = part == 0 ? (name == "runs" ? runs_ : sweeps_) : file / name;
    std::error_code none;
    if (part > 0 && fs::is_symlink(fs::symlink_status(file, none))) return missing;
    begin = end + 1;
  }
  std::error_code none;
  if (!fs::is_regular_file(file, none)) return missing;
  // It is held in memory while it is sent.
  if (fs::file_size(file, none) > kLargestFile)
    return {413, R"({"error":"is larger than 64 MB; read it on the machine itself"})"};
  const std::string type = type_of(file);
  view::WebReply reply = sandboxed(read_whole_file(file), type);
  if (type == "application/octet-stream")
    reply.headers.emplace_back("Content-Disposition", "attachment");
  return reply;
}

}  // namespace vitreo::serve
