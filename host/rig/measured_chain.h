// Measured viewing chain: what a calibration of eye, condensing lens, microscope and robot found,
// as the file that model.chain names has it (docs/chain.md).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"
#include "host/rig/rig.h"
#include "optics/chain/chain_doubt.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

struct MeasuredChain {
  optics::ChainBelief belief;
  /// Landings on the retina are in it, from which heights are counted; else places that a side
  /// camera saw, whose world it then has.
  bool touched = false;
  BenchUncertainty before{};  // what the rig said of the bench that was measured
  /// px, of each semi-axis: how far the session's outlines were from this chain's, beside what all
  /// have in common (its dilation).
  double outline_px = kUsualOutline_px;
  static constexpr double kUsualOutline_px = 0.1;  // of a file without it
  std::string text{};                              // the file's, for a run's record
  /// Of a parameter, in its own unit, 0 where it is held; of two, along x and y, the larger.
  double sigma(const std::string& name) const;
};

/// The chain that a rig believes.
optics::NominalChain nominal_chain(const RigModel& model);

/// From a file's text: {"about": {"eye", "robot", "pixel", "center", "pupil_power", "tilt"}, "eye",
/// "touched", "outline_px" (0.1), "parameters": [{"name", "off", "sigma"}], "covariance"}: SI;
/// `off` and `covariance` (row by row) are what was found, `sigma` was known before. Nothing where
/// it was measured about another belief than the rig's; where the eye or the robot is another one,
/// what is theirs is known no better than before. Both are a line in `warnings`. Throws
/// std::invalid_argument naming what is wrong.
std::shared_ptr<const MeasuredChain> read_measured_chain(const std::string& text,
                                                         const RigModel& model,
                                                         std::vector<std::string>& warnings);

/// The chain of the file that model.chain names becomes what `model` believes; nothing where none
/// is named. Throws ConfigError naming the file.
void take_chain(const RigDescription& rig, const std::string& name, RigModel& model,
                std::vector<std::string>& warnings);

/// What the rig file and the chain that it names say for nothing or against each other: keys that
/// nothing reads, what is drawn and said to be known. Opens nothing. Throws ConfigError.
std::vector<std::string> warnings_of(const RigDescription& rig);

/// The model with that chain, and with what is left of the bench's uncertainty.
void use_measured_chain(RigModel& model, std::shared_ptr<const MeasuredChain> chain);

/// The model without it: by centered optics, of the bench what the rig said before. Of a loop whose
/// view a look on the retina has put right, which is a correction of those.
RigModel without_measured_chain(RigModel model);

}  // namespace vitreo
