// Arguments and results of the viewing chain's calls.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/optics/bind_optics.h"
#include "optics/chain/chain_planner.h"
#include "optics/chain/chain_refiner.h"

#include <memory>
#include <vector>

namespace vitreo::lua::chain_calls {

struct Chain {
  optics::NominalChain nominal;
  optics::ChainSigmas sigmas;
  optics::ChainBelief belief;
  /// Of a chain that frames of a run have refined: what the next ones are added to.
  std::shared_ptr<const optics::ChainRefiner> refiner{};
  /// What it was calibrated by, to be linearized anew when frames refine it.
  optics::ChainAnchors anchors{};
};

/// viewing_chain:refine and its row, in bind_optics_refine.cpp.
Binding refine_row();

/// The option `uncertainty`: what is not given keeps the default of a bench set up by hand.
Argument uncertainty_argument();
optics::ChainSigmas sigmas_option(const Call& call);

/// The options `looks`, `landmarks` and `numbers`. Throws std::invalid_argument naming an entry and
/// what is wrong with it.
std::vector<Argument> session_arguments();
optics::ChainSession session_options(const Call& call);

/// A list of all parameters: before, and after what was measured.
std::vector<ResultField> parameter_fields();

/// A position with its uncertainty, the parts apart.
std::vector<ResultField> position_fields();
int push_position(const Call& call, const Eigen::Vector3d& position, double height,
                  const optics::PositionDoubt& doubt);

}  // namespace vitreo::lua::chain_calls
