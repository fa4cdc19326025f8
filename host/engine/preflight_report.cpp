// SPDX-License-Identifier: Apache-2.0
#include "host/engine/preflight_report.h"

#include "host/record/disk_watch.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>

namespace vitreo {
namespace {

/// "stage x: 3 moves, 0 mm to 2 mm".
std::string axis_text(const AxisUse& use) {
  return fmt::format("{}{}: {} move{}, {} to {}", use.role, use.axis.empty() ? "" : " " + use.axis,
                     use.moves, use.moves == 1 ? "" : "s", format_quantity(use.min, use.unit),
                     format_quantity(use.max, use.unit));
}

/// A: the peak of the coil with the largest one.
double largest(const std::vector<double>& peaks) {
  return peaks.empty() ? 0 : *std::max_element(peaks.begin(), peaks.end());
}

}  // namespace

std::string to_text(const PreflightReport& report) {
  std::string text = "parameters, roles and limits are in order\n";
  text +=
      fmt::format("{}: at least {} (simulated within {})\n",
                  report.simulated ? "dry run to the script's end" : "dry run",
                  format_quantity(report.duration, "s"), format_quantity(report.wall_time, "s"));
  if (report.coils.energized > 0)
    text += fmt::format("coils: up to {} in one, {} in all, energized for {}\n",
                        format_quantity(largest(report.coils.peak), "A"),
                        format_quantity(report.coils.peak_total, "A"),
                        format_quantity(report.coils.energized, "s"));
  for (const AxisUse& use : report.moves) text += axis_text(use) + "\n";
  text += "disk: at least " + size_text(static_cast<std::uint64_t>(report.disk_bytes)) + "\n";
  for (const std::string& warning : report.warnings) text += "warning: " + warning + "\n";
  for (const std::string& problem : report.problems) text += "problem: " + problem + "\n";
  return text + (report.passed() ? "passed\n" : "failed\n");
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
          {"duration", report.duration},
          {"coils",
           {{"peak", report.coils.peak},
            {"peak_total", report.coils.peak_total},
            {"energized", report.coils.energized},
            {"trips", report.coils.trips}}},
          {"moves", moves},
          {"frame_bytes_per_second", report.frame_bytes_per_second},
          {"disk_bytes", report.disk_bytes},
          {"arguments_time", report.arguments_time},
          {"wall_time", report.wall_time}};
}

}  // namespace vitreo
