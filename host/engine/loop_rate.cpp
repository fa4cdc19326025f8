// SPDX-License-Identifier: Apache-2.0
#include "host/engine/loop_rate.h"

#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>

namespace vitreo {
namespace {

/// The role's load that a turn of the loop has a share in; null where it has none.
const LinkLoad* turn_of(const LinkLoads& rig, const std::string& role) {
  const auto found =
      std::find_if(rig.loads.begin(), rig.loads.end(), [&role](const LinkLoad& load) {
        return load.role == role && (load.each_turn || load.rate > 0);
      });
  return found == rig.loads.end() ? nullptr : &*found;
}

/// A side camera has a rate of its own, which is not the loop's.
std::string source_among(const LinkLoads& rig, const std::set<std::string>& sources) {
  for (const char* const role : {"top_camera", "pose_sensor"})
    if (turn_of(rig, role) != nullptr && (sources.empty() || sources.contains(role))) return role;
  return "";
}

/// Rates are computed from numbers of a rig file: equal ones must not differ by their rounding.
bool too_slow(const LinkTime& time, double rate) { return time.seconds * rate > 1 + 1e-9; }

std::string cost(const LinkLoad& load) {
  return fmt::format("{} takes {} ({}), so at most {}", load.command,
                     format_quantity(load.time.seconds, "s"), load.time.arithmetic,
                     format_quantity(1 / load.time.seconds, "Hz"));
}

}  // namespace

LoopRate loop_rate(const LinkLoads& rig, const std::set<std::string>& sources) {
  LoopRate rate;
  for (const LinkLoad& load : rig.loads)
    if (load.time.seconds > 0) rate.links.push_back(load);
  rate.source = source_among(rig, sources);
  if (const LinkLoad* const source = turn_of(rig, rate.source)) rate.asked = source->rate;
  double slowest = 0;
  for (const std::string& role : {rate.source, std::string("coils")}) {
    const LinkLoad* const load = turn_of(rig, role);
    if (load == nullptr || load->time.seconds <= slowest) continue;
    slowest = load->time.seconds;
    rate.held = 1 / slowest;
    rate.limit = role;
  }
  return rate;
}

std::vector<std::string> beyond_links(const LinkLoads& rig, const std::set<std::string>& sources) {
  std::vector<std::string> problems;
  for (const std::string& role : sources) {
    const LinkLoad* const load = turn_of(rig, role);
    if (load != nullptr && too_slow(load->time, load->rate))
      problems.push_back(fmt::format("{}: its link cannot hold frame_rate = {}: {}", role,
                                     format_quantity(load->rate, "Hz"), cost(*load)));
  }
  const LinkLoad* const source = turn_of(rig, source_among(rig, sources));
  const LinkLoad* const coils = turn_of(rig, "coils");
  if (sources.empty() || source == nullptr || coils == nullptr) return problems;
  if (too_slow(coils->time, source->rate))
    problems.push_back(
        fmt::format("coils: their link cannot hold a servo loop of {}, the rate of {}: {}",
                    format_quantity(source->rate, "Hz"), source->role, cost(*coils)));
  return problems;
}

}  // namespace vitreo
