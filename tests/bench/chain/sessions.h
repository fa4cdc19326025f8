// Calibration sessions on a true bench, as an operator records them: ex vivo with two windows, and
// in the eye.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_session.h"

#include "true_bench.h"
#include <random>

namespace vitreo::optics {

inline constexpr double kNoise_px = 0.2;
inline constexpr double kAxisSigma = 0.035;  // rad

/// Evenly in the workspace: within 4 mm of the axis, 2 to 9 mm before the retina.
Eigen::Vector3d random_place(std::mt19937_64& random);
/// Any direction in the horizontal plane, pitched by a normal number times `pitch` (rad).
Eigen::Vector3d random_axis(std::mt19937_64& random, double pitch);
Eigen::Vector3d tilted(const Eigen::Vector3d& axis, double sigma, std::mt19937_64& random);

/// Robot size to 0.2 %, the microscope on a target without an eye, and `places` seen by both
/// cameras through two windows to 10 um.
ChainSession bench_session(const TrueBench& truth, int places, std::mt19937_64& random);
/// Five landings, nothing else.
ChainSession landing_session(const TrueBench& truth, std::mt19937_64& random);
/// A frame of free flight somewhere in the workspace, pitched by 20 degrees.
ChainLook flight_look(const TrueBench& truth, std::mt19937_64& random);
/// Robot size, microscope, the lens' place by its reflexes; five landings, `frames` of free flight
/// with a pitch of 20 degrees, eight landmarks, keratometry and A-scan, axial length.
ChainSession in_eye_session(const TrueBench& truth, int frames, std::mt19937_64& random);

}  // namespace vitreo::optics
