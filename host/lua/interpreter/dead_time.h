// Dead time of a run:each: the part of its time in which things were only got ready.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <string>
#include <vector>

namespace vitreo::lua {

struct Context;
struct Lap;

/// Whether a wait of that name takes no data: moves to a place, homing, bringing the robot,
/// learning the background, looking for the robot, people, pauses. What measures, follows a path,
/// or waits because the script says so, does not count.
bool is_dead_time(const std::string& what);

/// Adds a wait to every run:each that is being walked.
void add_wait(Context& context, const std::string& what, Time duration);

/// At the end of a run:each: an event "loop" says how long it took, how much of that was dead time,
/// and with what; the outermost ones add up to the result dead_time.
void tell_dead_time(Context& context, const Lap& lap);

}  // namespace vitreo::lua
