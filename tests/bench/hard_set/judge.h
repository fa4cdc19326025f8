// Judge of the hard set: a tracker with default settings through one scene, against the truth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/bench/hard_set/scene.h"
#include "vision/color_tracker.h"

#include <vector>

namespace vitreo::hard_set {

struct Verdict {
  int shown = 0;  ///< frames in which 30 % of the robot or more are to be seen
  int lost = 0;   ///< of those, not tracked; the first two after it came into view are not counted
  int tracked = 0;
  int wrong = 0;         ///< tracked though it is not there, beyond 5 px or beyond 5 sigma
  int beyond_sigma = 0;  ///< of these, where it is there: beyond 5 sigma
  int inside = 0;        ///< tracked and there, within the measurement's own 95 %
  int there = 0;         ///< tracked and there
  int found_after = 0;   ///< most frames from coming into view to the first track of it, from 1
  double du = 0;         ///< the same, signed: a bias shows in the mean
  double dv = 0;
  double off_px = 0;   ///< summed over `there`
  double seconds = 0;  ///< CPU time of update() alone
  double worst_seconds = 0;
  int frames = 0;
  void add(const Verdict& other);
};

struct JudgeSettings {
  vision::ColorTrackerSettings tracker;
  bool each_frame = false;  ///< print one line a frame
  int repeats = 0;          ///< further runs, each frame's time is the least of all
};

Verdict judge(const Scene& scene, const vision::ObjectModel& model, const JudgeSettings& settings);

}  // namespace vitreo::hard_set
