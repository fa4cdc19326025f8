// `vitreo runs`: list of the recorded runs, newest last.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/commands.h"
#include "host/config/config.h"
#include "host/runs/run_reader.h"
#include "host/text/columns.h"
#include "host/text/terminal_text.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <iterator>
#include <ostream>
#include <string_view>
#include <vector>

namespace vitreo {
namespace {

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// Times are compared as texts: ISO 8601 of one zone sorts as it reads, and --since is the beginning
// of one, so only as many characters are compared as it has.
bool wanted(const RunHead& head, const RunFilter& filter) {
  if (!filter.protocol.empty() && !has(head.protocol, filter.protocol) &&
      !has(head.title, filter.protocol))
    return false;
  if (!filter.operator_name.empty() && !has(head.operator_name, filter.operator_name)) return false;
  if (!filter.state.empty() && head.state != filter.state) return false;
  return filter.since.empty() || head.time.substr(0, filter.since.size()) >= filter.since;
}

/// The beginning of "2026-11-21T14:30:05" at least as far as the year, or nothing.
bool is_time(const std::string& text) {
  constexpr std::string_view kShape = "dddd-dd-ddTdd:dd:dd";
  // The lengths at which a field is complete; 0 is the option that was not given.
  constexpr std::size_t kEnds[] = {0, 4, 7, 10, 13, 16, 19};
  if (std::find(std::begin(kEnds), std::end(kEnds), text.size()) == std::end(kEnds)) return false;
  for (std::size_t i = 0; i < text.size(); ++i)
    if (kShape[i] == 'd' ? text[i] < '0' || text[i] > '9' : text[i] != kShape[i]) return false;
  return true;
}

/// A filter that no run could pass is a mistake of typing.
void check(const RunFilter& filter) {
  static const std::vector<std::string> kStates{"completed", "failed",  "stopped",   "aborted",
                                                "lost",      "running", "unreadable"};
  if (!filter.state.empty() &&
      std::find(kStates.begin(), kStates.end(), filter.state) == kStates.end())
    throw ConfigError(
        fmt::format("--outcome: wants one of {}; got {}", fmt::join(kStates, ", "), filter.state));
  if (!is_time(filter.since))
    throw ConfigError("--since: wants a time such as 2026-11-21 or 2026-11-21T14:30; got " +
                      filter.since);
}

// SI and untruncated, unlike the line for people below.
nlohmann::json json_of(const RunHead& head) {
  return {{"run", std::filesystem::path(head.folder).filename().string()},
          {"folder", head.folder},
          {"time", head.time},
          {"protocol", head.protocol},
          {"title", head.title},
          {"operator", head.operator_name},
          {"seed", head.seed},
          {"outcome", head.state},
          {"reason", head.reason},
          {"experiment_time", head.experiment_time}};
}

// A line a run: of the reason only the first line, without control characters, since it may be a
// script's text. `time` is formatted by the caller, with all runs in one unit.
void print(const RunHead& head, const std::string& time, std::ostream& out) {
  out << fmt::format("{:<44} {:<10} {:>9}  {}{}\n",
                     std::filesystem::path(head.folder).filename().string(), head.state, time,
                     head.title,
                     head.reason.empty()
                         ? ""
                         : ": " + for_terminal(head.reason.substr(0, head.reason.find('\n')), 300));
}

}  // namespace

int list_runs(const std::filesystem::path& parent, const RunFilter& filter, bool json,
              std::ostream& out) {
  check(filter);
  std::vector<RunHead> heads;
  // read_head() reads the two short records, not the data, and does not throw: a broken run is
  // listed as unreadable instead of ending the list.
  for (const std::filesystem::path& folder : run_folders(parent)) {
    RunHead head = read_head(folder);
    if (wanted(head, filter)) heads.push_back(std::move(head));
  }
  // Counted after the filter, so that `--protocol x --newest 5` is the five newest of that
  // protocol.
  const auto newest = static_cast<std::size_t>(filter.newest);
  if (newest > 0 && heads.size() > newest) heads.erase(heads.begin(), heads.end() - filter.newest);
  if (json) {
    nlohmann::json rows = nlohmann::json::array();
    for (const RunHead& head : heads) rows.push_back(json_of(head));
    out << rows.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << "\n";
    return 0;
  }
  std::vector<double> times;
  for (const RunHead& head : heads) times.push_back(head.experiment_time);
  const ShownColumn column = show_column(times, "s");
  for (std::size_t i = 0; i < heads.size(); ++i)
    print(heads[i], with_unit({column.numbers[i], column.unit}), out);
  const bool filtered = !filter.protocol.empty() || !filter.operator_name.empty() ||
                        !filter.state.empty() || !filter.since.empty();
  if (heads.empty())
    out << "no " << (filtered ? "such " : "") << "runs in " << parent.string() << "\n";
  return 0;
}

}  // namespace vitreo
