// SPDX-License-Identifier: Apache-2.0
#include "host/trials/reproduction_joined.h"

#include "host/record/thesis_verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace vitreo {
namespace {

/// The mean of the middle two of an even number; NaN of none.
double median_of(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
}

// The first of that id; null where no run brought one, as in a part of the plan.
const ReproducedRow* row_named(const std::vector<ReproducedRun>& runs, const std::string& id) {
  for (const ReproducedRun& run : runs)
    for (const ReproducedRow& row : run.rows)
      if (row.id == id) return &row;
  return nullptr;
}

std::string tolerance_of(const JoinedRow& wanted) {
  if (!wanted.at_most) return "none";
  return "at most " + quantity_text(*wanted.at_most, wanted.unit) +
         (wanted.reason.empty() ? "" : " (" + wanted.reason + ")");
}

/// `missing` gets the ids of the rows that no run brought.
/// The median is taken over the single values where a row states them, since a median of medians is
/// not the median of all.
ReproducedRow joined(const JoinedRow& wanted, const std::vector<ReproducedRun>& runs,
                     std::string& missing) {
  std::vector<double> values;
  std::string members;
  for (const std::string& id : wanted.of) {
    const ReproducedRow* const row = row_named(runs, id);
    if (row == nullptr) {
      missing += (missing.empty() ? "" : ", ") + id;
      continue;
    }
    members += fmt::format("{}{}: {}", members.empty() ? "" : ", ", id,
                           quantity_text(row->ours, row->unit));
    if (row->values.empty())
      values.push_back(row->ours);
    else
      values.insert(values.end(), row->values.begin(), row->values.end());
  }
  ReproducedRow made;
  made.id = wanted.id;
  made.what = fmt::format("{} ({} values)", wanted.what, values.size());
  made.where = wanted.where;
  made.unit = wanted.unit;
  made.ours = missing.empty() ? median_of(std::move(values)) : std::nan("");
  made.tolerance = tolerance_of(wanted);
  made.verdict = to_string(judge({.ours = made.ours, .at_most = wanted.at_most}).verdict);
  made.why = missing.empty() ? members : "missing: " + missing;
  return made;
}

}  // namespace

// The complement of read_plan(): each passes over the other's entries in the same file. A bar has
// the unit of the row, so that it is checked like any number of a rig file.
std::vector<JoinedRow> read_joined(const RigDescription& plan) {
  constexpr double kNoLimit = std::numeric_limits<double>::infinity();
  std::vector<JoinedRow> rows;
  ConfigReader reader(plan);
  for (const std::string& key : reader.keys()) {
    ConfigReader one = reader.table(key);
    if (!one.has("joins")) continue;
    JoinedRow row;
    row.of = one.texts("joins");
    if (row.of.empty()) one.fail("joins", "must name the rows that are joined");
    row.id = one.text("id", key);
    row.what = one.text("what", "");
    row.where = one.text("where", "");
    row.unit = one.text("unit", "");
    row.reason = one.text("reason", "");
    if (row.what.empty()) one.fail("what", "must be given");
    if (one.has("at_most")) row.at_most = one.number("at_most", 0, {-kNoLimit, kNoLimit, row.unit});
    one.finish();
    rows.push_back(std::move(row));
  }
  return rows;
}

// The section has the form of a run, without a rig, so that pages and verdicts treat it alike.
ReproducedRun join_rows(const std::vector<JoinedRow>& wanted,
                        const std::vector<ReproducedRun>& runs, bool whole) {
  ReproducedRun section;
  section.plan.protocol = "several runs together";
  section.outcome = "completed";
  for (const JoinedRow& one : wanted) {
    std::string missing;
    ReproducedRow row = joined(one, runs, missing);
    if (whole || missing.empty()) section.rows.push_back(std::move(row));
  }
  return section;
}

}  // namespace vitreo
