// Support of the chain's tests: a nominal chain, draws of its parameters and places in it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_ellipse.h"

#include <cstdint>
#include <random>
#include <vector>

namespace vitreo::optics {

/// Table 5.3's eye under a telecentric microscope focused on 5 mm before the retina, 14.3 um a
/// pixel, with the robot of 2 by 1 mm.
inline NominalChain nominal_chain() {
  NominalChain nominal;
  nominal.prescription = prescription("model_eye_5_3");
  return nominal;
}

inline ViewingChain chain_at_zero(const NominalChain& nominal, const ChainSigmas& sigmas = {}) {
  const auto parameters = chain_parameters(nominal, sigmas);
  return {nominal, parameters, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size()))};
}

inline Eigen::VectorXd drawn_theta(const std::vector<ChainParameter>& parameters,
                                   std::uint64_t seed, double width = 1) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Eigen::VectorXd theta(static_cast<Eigen::Index>(parameters.size()));
  for (double& one : theta) one = width * normal(random);
  return theta;
}

inline std::vector<RobotPlace> places() {
  const auto at = [](double x, double y, double z, double ax, double ay, double az) {
    return RobotPlace{{x, y, z}, Eigen::Vector3d(ax, ay, az).normalized(), {0, 0}};
  };
  return {at(0, 0, 5e-3, 1, 0, 0), at(2e-3, -1e-3, 4e-3, 1, 0.1, 0.3),
          at(-3e-3, 2e-3, 7e-3, 0.2, 1, -0.3), at(1e-3, 3e-3, 2e-3, 0, 0.1, 1)};
}

}  // namespace vitreo::optics
