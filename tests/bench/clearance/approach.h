// One simulated approach to the retina, judged by dense samples of the true body's surface against
// the true eye: what the loop showed meanwhile, and whether it touched.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/servo/servo.h"

#include <cstdint>
#include <string>

namespace vitreo::approaches {

struct ApproachSetting {
  std::uint64_t seed = 1;
  bool upright = false;
  bool perturbed_eye = false;  // off by table 5.1; the rig says that it may be
  bool sampled_bench = false;  // truth.optics.bench; the rig says that it was set up by hand,
  bool told = true;            // or that it is known
  Feedback feedback = Feedback::one_camera;
  ControlLaw law = ControlLaw::estimator;
  double margin = 0.2e-3;  // m
  bool sink = false;  // let down until it lies there, the margin off; else driven to the margin
  int faults = 0;     // drawn from the seed
};

struct ApproachResult {
  double optimism = -1;     // m, the most by which the shown bound was above the true clearance
  double least_true = 1;    // m
  double least_driven = 1;  // m, while the coils did what the loop told them
  double end_true = 1;      // m
  double end_bound = 1;     // m, that was shown at the end
  double uncertainty = 0;   // m, then
  double bias = 0;          // m, shown distance less the true one, then
  double excess = -1e9;     // the most that the distance was too large, over its half width
  double below = 0;         // m, median of the true clearance less the bound
  bool touched = false;     // at any time
  // At the first touch: the loop was at work and the coils did what it told them; it had ended.
  bool driven = false;
  bool ended = false;
  bool red_first = true;  // "very close" was shown before the first touch
  bool alarm = false;     // of margin or wall, before the end
  std::string plan;       // the faults
  std::string ending;     // of the loop
};

ApproachResult run_approach(const ApproachSetting& setting);

}  // namespace vitreo::approaches
