// SPDX-License-Identifier: Apache-2.0
#include "host/trials/reproduction_laboratory.h"

#include "host/files/run_folder.h"

#include <algorithm>
#include <cmath>
#include <fstream>

namespace vitreo {
namespace {

/// {run: {row: number}}; an empty object where there is no such file.
nlohmann::json kept_in(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) return nlohmann::json::object();
  nlohmann::json kept = nlohmann::json::parse(in, nullptr, false);
  if (!kept.is_object())
    throw std::runtime_error(file.string() + ": is not what `vitreo reproduce --laboratory` wrote");
  return kept;
}

}  // namespace

std::vector<PlannedRun> laboratory_runs(const std::vector<PlannedRun>& plan) {
  std::vector<PlannedRun> runs;
  std::copy_if(plan.begin(), plan.end(), std::back_inserter(runs),
               [](const PlannedRun& run) { return !run.laboratory.empty(); });
  return runs;
}

// A run that did not complete leaves no number behind: that of an older program would stand for it.
void keep_laboratory(const std::vector<ReproducedRun>& runs, const std::filesystem::path& file) {
  nlohmann::json kept = kept_in(file);
  for (const ReproducedRun& run : runs) {
    nlohmann::json& rows = kept[run.plan.key] = nlohmann::json::object();
    for (const ReproducedRow& row : run.rows)
      if (std::isfinite(row.ours)) rows[row.id] = row.ours;
  }
  write_file(file, kept.dump(1) + "\n");
}

void join_laboratory(std::vector<ReproducedRun>& runs, const std::filesystem::path& file) {
  const nlohmann::json kept = kept_in(file);
  for (ReproducedRun& run : runs) {
    const auto rows = kept.find(run.plan.key);
    if (rows == kept.end() || !rows->is_object()) continue;
    for (ReproducedRow& row : run.rows)
      if (const auto found = rows->find(row.id); found != rows->end() && found->is_number())
        row.laboratory = found->get<double>();
  }
}

}  // namespace vitreo
