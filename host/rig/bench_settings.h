// Bench settings: how well a rig says that it knows where eye, condensing lens and microscope
// stand, and what counts where it says nothing.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/optics_sample.h"
#include "host/config/config.h"
#include "host/rig/view_uncertainty.h"

#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// One key of model.uncertainty.bench, a standard deviation.
struct BenchKey {
  /// Whose doubt it is: of every picture, of one through an eye, or of the walls too.
  enum class Of { picture, eye, walls };
  const char* name;
  double BenchUncertainty::*sigma;
  double sim::OpticsSigmas::*drawn;  // by which truth.optics draws the same
  Of of;
  Bounds bounds;
  const char* help;
};
std::span<const BenchKey> bench_keys();

/// What a rig file says of the pictures of its top camera by what else it has.
struct BenchFacts {
  bool pictures = false;      // there is a top camera
  bool shows_eye = false;     // which looks through the eye
  bool simulated = false;     // its pictures are drawn
  sim::OpticsSigmas plant{};  // by which they are off what the rig believes
};

/// model.uncertainty.bench. `places` is by default "known" of a bench that is drawn as believed,
/// and of a picture without an eye; of every other one "by_hand": what is not given is that of a
/// bench set up by hand. A line is added to `warnings` for what is drawn and counts as known, and
/// for each key that nothing reads. Throws ConfigError.
BenchUncertainty read_bench(ConfigReader reader, const BenchFacts& facts,
                            std::vector<std::string>& warnings);

}  // namespace vitreo
