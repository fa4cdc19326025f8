// Estimator of the whole viewing chain: the most probable eye, retina, lens place, eye rotation,
// microscope, scale, center, robot size and inner lens for all measurements of a session together.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_session.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace vitreo::optics {

struct ChainEstimatorSettings {
  /// Starts: the nominal eye, and turned by as much along x and y both ways, in its own sigmas. The
  /// eye's rotation and the condensing lens' place have twin solutions
  /// (docs/chain.md); fewer than five starts are for comparison only.
  int starts = 5;
  double start_rotation = 1.2;
  int max_iterations = 200;
  /// Minima within this of the best are all reported: 99 % of a chi2 with two degrees of freedom.
  double equal_chi2 = 9.2;
};

/// One of the chains that explain the session.
struct ChainMinimum {
  Eigen::VectorXd theta;
  Eigen::MatrixXd covariance;
  double chi2 = 0;  // of the measurements and of what was known beforehand
};

enum class SessionStatus {
  found,          // one minimum, whose chi2 is that of a right session
  ambiguous,      // several minima: twins
  misfit,         // no chain within the priors explains all of the session
  not_converged,  // no start came to rest at a minimum
};
const char* to_string(SessionStatus status);

/// A look that the chain of the others does not explain.
struct LookMisfit {
  std::size_t look = 0;  // of the session
  double chi2 = 0;       // of its rows, by a solve in which it hardly counts
};

struct ChainEstimate {
  /// Of `misfit` and `not_converged` the belief is no result: its covariance is that of a minimum
  /// which the session contradicts.
  SessionStatus status = SessionStatus::found;
  /// The best minimum. With twins its covariance is that of all minima, weighted by exp(-chi2 / 2),
  /// about the best.
  ChainBelief belief;
  std::vector<ChainMinimum> minima{};  // the best first
  double chi2 = 0;
  int degrees_of_freedom = 0;             // numbers measured and known beforehand less unknowns
  std::vector<Eigen::Vector3d> places{};  // of the looks, nominal eye frame
  int ended_starts = 0;                   // that led to a minimum
  double chi2_limit = 0;                  // a right session is above it in one case of 200
  /// Of a misfit, the looks without which the rest fits, the worst first. Empty: it is not a few
  /// looks, but the chain (a part that is not in it, a wrong sigma) or a number measured wrongly.
  std::vector<LookMisfit> outliers{};
};

/// Least squares (Ceres) of the priors and all measurements; every look has its own place and axis.
/// A session that does not fit, and not for a few of its looks, is tried again from four more
/// starts before it is called so.
/// Throws std::invalid_argument naming a bad measurement, or `session` when no start leads to a
/// minimum.
ChainEstimate estimate_chain(const NominalChain& nominal, const ChainSigmas& sigmas,
                             const ChainSession& session,
                             const ChainEstimatorSettings& settings = {});

/// Information of a session at a belief, the looks at the places where they are believed to be:
/// what it would add, without its data. Looks that are not shown add nothing.
Eigen::MatrixXd session_information(const ViewingChain& chain, const ChainSession& session,
                                    const std::vector<Eigen::Vector3d>& places);

}  // namespace vitreo::optics
