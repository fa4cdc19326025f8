// `vitreo runs`: what was recorded, newest last.
// SPDX-License-Identifier: Apache-2.0
#include "host/commands.h"
#include "host/run_reader.h"
#include "host/units.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <ostream>

namespace vitreo {
namespace {

bool has(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

bool wanted(const RunHead& head, const RunFilter& filter) {
  if (!filter.protocol.empty() && !has(head.protocol, filter.protocol) && !has(head.title, filter.protocol))
    return false;
  if (!filter.operator_name.empty() && !has(head.operator_name, filter.operator_name)) return false;
  if (!filter.state.empty() && head.state != filter.state) return false;
  return filter.since.empty() || head.time.substr(0, filter.since.size()) >= filter.since;
}

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

void print(const RunHead& head, std::ostream& out) {
  out << fmt::format("{:<44} {:<10} {:>9}  {}{}\n", std::filesystem::path(head.folder).filename().string(), head.state,
                     format_quantity(head.experiment_time, "s"), head.title,
                     head.reason.empty() ? "" : ": " + head.reason);
}

}  // namespace

int list_runs(const std::filesystem::path& parent, const RunFilter& filter, bool json, std::ostream& out) {
  std::vector<RunHead> heads;
  for (const std::filesystem::path& folder : run_folders(parent)) {
    RunHead head = read_head(folder);
    if (wanted(head, filter)) heads.push_back(std::move(head));
  }
  const auto newest = static_cast<std::size_t>(filter.newest);
  if (newest > 0 && heads.size() > newest) heads.erase(heads.begin(), heads.end() - filter.newest);
  if (json) {
    nlohmann::json rows = nlohmann::json::array();
    for (const RunHead& head : heads) rows.push_back(json_of(head));
    out << rows.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << "\n";
    return 0;
  }
  for (const RunHead& head : heads) print(head, out);
  if (heads.empty()) out << "no runs in " << parent.string() << "\n";
  return 0;
}

}  // namespace vitreo
