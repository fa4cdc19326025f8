// SPDX-License-Identifier: Apache-2.0
#include "host/engine/preflight_report.h"

#include "host/record/disk_watch.h"
#include "host/text/columns.h"
#include "host/text/units.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

namespace vitreo {
namespace {

/// Lines of the axes; those of one dimension have one unit.
/// Two passes, since the unit of a column follows from all its values: `taken` counts how many
/// numbers of each dimension were used up.
std::string axes_text(const std::vector<AxisUse>& moves) {
  std::map<std::string, std::vector<double>> limits;
  for (const AxisUse& use : moves)
    limits[use.unit].insert(limits[use.unit].end(), {use.min, use.max});
  std::map<std::string, ShownColumn> columns;
  for (const auto& [unit, values] : limits) columns[unit] = show_column(values, unit);
  std::map<std::string, std::size_t> taken;
  std::string text;
  for (const AxisUse& use : moves) {
    const ShownColumn& column = columns[use.unit];
    std::size_t& next = taken[use.unit];
    text +=
        fmt::format("{}{}: {} move{}, {} to {}\n", use.role, use.axis.empty() ? "" : " " + use.axis,
                    use.moves, use.moves == 1 ? "" : "s", column.numbers[next],
                    with_unit({column.numbers[next + 1], column.unit}));
    next += 2;
  }
  return text;
}

/// A: the peak of the coil with the largest one.
double largest(const std::vector<double>& peaks) {
  return peaks.empty() ? 0 : *std::max_element(peaks.begin(), peaks.end());
}

/// What the links take, and the loop that they let through.
std::string links_text(const LoopRate& loop) {
  std::string text;
  for (const LinkLoad& load : loop.links)
    text += fmt::format("{}: {} takes {}: {}\n", load.role, load.command,
                        format_quantity(load.time.seconds, "s"), load.time.arithmetic);
  if (loop.held <= 0) return text;
  text += fmt::format("servo loop: the links hold {}, limited by {}",
                      format_quantity(loop.held, "Hz"), loop.limit);
  if (loop.asked > 0)
    text += fmt::format("; {} asks for {}", loop.source, format_quantity(loop.asked, "Hz"));
  return text + "\n";
}

nlohmann::json links_json(const LoopRate& loop) {
  nlohmann::json links = nlohmann::json::array();
  for (const LinkLoad& load : loop.links)
    links.push_back({{"role", load.role},
                     {"command", load.command},
                     {"time", load.time.seconds},
                     {"arithmetic", load.time.arithmetic}});
  return links;
}

}  // namespace

std::string to_text(const PreflightReport& report) {
  std::string text = "parameters, roles and limits are in order\n";
  text +=
      fmt::format("{}: at least {} (simulated within {})\n",
                  report.simulated ? "dry run to the script's end" : "dry run",
                  format_quantity(report.duration, "s"), format_quantity(report.wall_time, "s"));
  if (report.coils.energized > 0) {
    const ShownColumn peaks =
        show_column({largest(report.coils.peak), report.coils.peak_total}, "A");
    text += fmt::format("coils: up to {0} {2} in one, {1} {2} in all, energized for {3}\n",
                        peaks.numbers[0], peaks.numbers[1], peaks.unit,
                        format_quantity(report.coils.energized, "s"));
  }
  text += axes_text(report.moves);
  text += links_text(report.loop);
  text += "disk: at least " + size_text(static_cast<std::uint64_t>(report.disk_bytes)) + "\n";
  for (const std::string& warning : report.warnings) text += "warning: " + warning + "\n";
  for (const std::string& problem : report.problems) text += "problem: " + problem + "\n";
  if (!report.not_looked_at.empty())
    text += fmt::format("not looked at: {}\n", fmt::join(report.not_looked_at, "; "));
  if (!report.passed()) return text + "failed\n";
  return text + (report.simulated ? "passed\n"
                                  : "passed as far as it came: a longer --limit may go further\n");
}

nlohmann::json to_json(const PreflightReport& report) {
  nlohmann::json moves = nlohmann::json::array();
  for (const AxisUse& use : report.moves)
    moves.push_back({{"role", use.role},
                     {"axis", use.axis},
                     {"unit", use.unit},
                     {"moves", use.moves},
                     {"min", use.min},
                     {"max", use.max}});
  return {{"passed", report.passed()},
          {"fully_simulated", report.simulated},
          {"problems", report.problems},
          {"warnings", report.warnings},
          {"not_looked_at", report.not_looked_at},
          {"duration", report.duration},
          {"coils",
           {{"peak", report.coils.peak},
            {"peak_total", report.coils.peak_total},
            {"energized", report.coils.energized},
            {"trips", report.coils.trips}}},
          {"moves", moves},
          {"links", links_json(report.loop)},
          {"servo_loop",
           {{"held", report.loop.held},
            {"limited_by", report.loop.limit},
            {"asked", report.loop.asked},
            {"asked_by", report.loop.source}}},
          {"frame_bytes_per_second", report.frame_bytes_per_second},
          {"disk_bytes", report.disk_bytes},
          {"arguments_time", report.arguments_time},
          {"wall_time", report.wall_time}};
}

}  // namespace vitreo
