// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/eye_look.h"

#include "optics/chain/chain_estimator.h"
#include "optics/numerics/preconditions.h"

#include <Eigen/LU>

#include <limits>

namespace vitreo::optics {
namespace {

ChainLook chain_look(const EyeLook& look) {
  detail::require_positive(look.known_z_sigma, "known_z_sigma");
  ChainLook one;
  one.seen = look.seen;
  one.axis = look.axis;
  return one;
}

}  // namespace

/// No part of the bench can turn, so that there are no twins to be started from.
ProbableView most_probable_view(const NominalChain& nominal, const EyeLook& look,
                                const BenchDoubt& bench) {
  constexpr double kUnknown = std::numeric_limits<double>::infinity();
  ChainLook at_height = chain_look(look);
  at_height.known = {0, 0, look.known_z};
  at_height.known_sigma = {kUnknown, kUnknown, look.known_z_sigma};
  ChainSigmas sigmas = ChainSigmas::none();
  sigmas.eye = applicable(table_5_1(), nominal.prescription);
  sigmas.pixel = bench.pixel;
  sigmas.robot_size = bench.robot_size;
  ChainSession session;
  session.looks.push_back(at_height);
  ChainEstimatorSettings once;
  once.starts = 1;
  const ViewingChain chain = estimate_chain(nominal, sigmas, session, once).belief.chain;
  const auto off = [&](const char* name, double sigma) {
    return sigma > 0 ? 1 + sigma * chain.theta()[index_of(chain.parameters(), name)] : 1;
  };
  ProbableView view{nominal.prescription, off("pixel", bench.pixel),
                    off("robot_length", bench.robot_size), off("robot_width", bench.robot_size)};
  for (const Uncertainty& one : sigmas.eye)
    view.eye = perturbed(view.eye, one, chain.theta()[index_of(chain.parameters(), one.parameter)]);
  return view;
}

Prescription most_probable_eye(const NominalChain& nominal, const EyeLook& look) {
  return most_probable_view(nominal, look, {}).eye;
}

/// With H the look's information and C_e the variances that were reckoned with, the estimate is
/// M B'y, M = C_e (1 + H C_e)^-1, of rows y = B theta + n, B'B = H: its error (1 - M H) theta - M
/// B'n has the covariance (1 - M H) C (1 - M H)' + M H M', which for C_e = C is (C^-1 + H)^-1.
std::optional<ChainBelief> eye_calibrated(const ChainBelief& prior, const EyeLook& look,
                                          const Eigen::VectorXd& reckoned) {
  detail::require(reckoned.size() == prior.chain.size() && (reckoned.array() >= 0).all(),
                  "reckoned: wants a variance, 0 or above, of each parameter");
  ChainLook lying = chain_look(look);
  lying.contact_sigma = look.known_z_sigma;
  lying.lying_height = look.known_z;
  const auto block = block_of(prior.chain, lying, {0, 0, look.known_z}, {0, 0}, true);
  if (!block) return std::nullopt;
  const Eigen::MatrixXd H = information_of(*block);
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(H.rows(), H.cols());
  const Eigen::MatrixXd by_estimate = reckoned.asDiagonal();
  const Eigen::MatrixXd M = by_estimate * (one + H * by_estimate).partialPivLu().inverse();
  const Eigen::MatrixXd left = one - M * H;
  ChainBelief after = prior;
  after.covariance = left * prior.covariance * left.transpose() + M * H * M.transpose();
  return after;
}

}  // namespace vitreo::optics
