// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/dead_time.h"

#include "host/lua/interpreter/context.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace vitreo::lua {
namespace {

// Waits have the names of their calls. What is not here measures, follows a path, or waits because
// the script asked for it.
constexpr std::array kGettingReady{
    "servo:go_to",     "servo:wait_until_tracked", "stage:move_to",       "stage:home",
    "motion:wait",     "rotation_stage:move_to",   "rotation_stage:home", "lens_mover:move_to",
    "lens_mover:home", "sample:insert_robot",      "sample:remove_robot", "rig:learn_background",
    "resume",
};

}  // namespace

bool is_dead_time(const std::string& what) {
  // People: an answer to a question, and a pause that waits for its end.
  const bool people = what.starts_with("an answer to '") || what.ends_with("' to end");
  return people ||
         std::find(kGettingReady.begin(), kGettingReady.end(), what) != kGettingReady.end();
}

// To all that are being walked: an inner loop's wait is the outer ones' too.
void add_wait(Context& context, const std::string& what, Time duration) {
  if (duration <= Time(0)) return;
  for (Lap& lap : context.laps) lap.waited[what] += to_seconds(duration);
}

// The longest waits first. Nothing for a loop without a turn.
void tell_dead_time(Context& context, const Lap& lap) {
  if (context.session == nullptr) return;
  Session& session = *context.session;
  const double whole = to_seconds(session.clock.now() - lap.began);
  if (whole <= 0 || lap.index == 0) return;
  std::vector<std::pair<double, std::string>> parts;
  double dead = 0;
  for (const auto& [what, seconds] : lap.waited)
    if (is_dead_time(what)) {
      parts.emplace_back(seconds, what);
      dead += seconds;
    }
  std::sort(parts.rbegin(), parts.rend());
  std::string text =
      fmt::format("{}: {} turns in {}, dead time {} ({:.1f} %)", lap.label, lap.index,
                  format_quantity(whole, "s"), format_quantity(dead, "s"), 100 * dead / whole);
  for (std::size_t i = 0; i < parts.size(); ++i)
    text += fmt::format("{}{} {:.1f} %", i == 0 ? ": " : ", ", parts[i].second,
                        100 * parts[i].first / whole);
  session.recorder.event(session.clock.now(), "loop", text);
  // Only the outermost loop counts for the run, or what nested ones waited would count twice.
  if (context.laps.size() != 1) return;
  context.dead_time += dead;
  session.recorder.result({"dead_time", context.dead_time, "s"});
}

}  // namespace vitreo::lua
