// Solve of a calibration session from one start: the chain, place and axis of every look, and the
// landmarks' places, by least squares.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_estimator.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace vitreo::optics::detail {

/// Where one start led.
struct ChainEnd {
  ChainMinimum minimum;
  std::vector<Eigen::Vector3d> places;  // of the looks, m, nominal eye frame
  std::vector<double> look_chi2;        // of each look's rows, axis and knowledge of its place too
  bool converged = false;
};

/// How the solver goes about it.
struct ChainWay {
  /// Parameters that stay where they start while the looks are relaxed, by their index: a start
  /// that is turned would else melt into the one that is not.
  std::vector<int> held;
  /// Looks count by Cauchy's loss of this scale, in their own sigmas; 0: by their squares.
  double robust = 0;
};

/// Levenberg and Marquardt's method (Ceres) from a start whose looks are relaxed: their sigmas are
/// first a hundred, then ten times as large. With five hundredths of a pixel weighed against half a
/// millimeter the valleys are so narrow and bent that a solve by whole weights crawls along them:
/// from the same starts it had not ended after 200 iterations (chi2 1361 of 159 degrees), with
/// relaxed looks it ends after 40 (150). Nothing where a look is not shown.
/// Throws std::invalid_argument naming a bad measurement.
std::optional<ChainEnd> solve_chain(const NominalChain& nominal,
                                    const std::vector<ChainParameter>& parameters,
                                    const ChainSession& session,
                                    const ChainEstimatorSettings& settings,
                                    const Eigen::VectorXd& start, const ChainWay& way);

}  // namespace vitreo::optics::detail
