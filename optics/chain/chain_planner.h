// Planner of calibrations: which measurement of a list would take most of what is not known of
// positions, one after the other (greedy information gain).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_estimator.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

namespace vitreo::optics {

/// What the plan makes small, the part of it that averaging frames does not: the height above the
/// touched retina, the absolute depth, or the place aside.
enum class PlanGoal { height, depth, aside };

struct PlanCandidate {
  std::string name;
  Eigen::MatrixXd information;  // session_information()
};
struct PlanStep {
  std::string name;
  double leaves = 0;  // m, one sigma: median over the workspace
};

/// What a tracker of this noise (px, of center and semi-axes) will see there by the chain, the axis
/// known to `axis_sigma` (rad): a plan has no data, and the information of a look depends on where
/// it is taken, not on what noise it will have. Nothing where the chain does not show it.
std::optional<OutlineSeen> planned_outline(const ViewingChain& chain, const RobotPlace& place,
                                           double sigma_px, double axis_sigma);

/// Places evenly over the workspace, 4 mm about the axis and 2 to 9 mm before the retina.
std::vector<Eigen::Vector3d> workspace_places();

/// What the belief leaves of the goal now, m.
double left_of(const ChainBelief& belief, PlanGoal goal);

/// At most `steps` of the candidates, in the order in which they gain most; each is taken once.
/// Information is additive, so a plan costs milliseconds.
std::vector<PlanStep> plan(const ChainBelief& belief, std::vector<PlanCandidate> candidates,
                           PlanGoal goal, int steps);

/// What a laboratory usually can do next: frames of free flight, places seen by two side windows,
/// landings, landmarks, the microscope on a target, the lens' place by its reflexes, the robot's
/// size, the vitreous index, keratometry with A-scan, retinal depth by OCT. Those whose parameters
/// the chain holds.
std::vector<PlanCandidate> usual_candidates(const ChainBelief& belief);

/// Parameters of which the measurements taught less than a tenth of their variance, by name.
std::vector<std::string> unobserved(const ChainBelief& belief);

}  // namespace vitreo::optics
