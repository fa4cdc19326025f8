// Most probable eye by one look at the robot at a known height: thesis 5.4's calibration on the
// retina, of the eye's own numbers in place of the image's scale.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_session.h"

namespace vitreo::optics {

/// The robot where its height is known, as it lies on the retina.
struct EyeLook {
  OutlineSeen seen;                // its axis_sigma must be above 0
  Eigen::Vector3d axis;            // believed, unit, eye frame
  double known_z = 0;              // m, of its center over the retina's vertex
  double known_z_sigma = 0.01e-3;  // m, above 0; by default what a retina is rough
};

/// What else the look's size may come from, relative sigmas: a bench that is not quite as believed.
/// The microscope's tilt is not among them: of one look it moves the place alone.
struct BenchDoubt {
  double pixel = 0;
  double robot_size = 0;  // of length and width each
};

/// The most probable view by table 5.1, bench and look: the eye, and by which factors pixel and
/// robot are larger than believed. With a doubt of 0 a factor is 1.
struct ProbableView {
  Prescription eye;
  double pixel = 1;
  double robot_length = 1;
  double robot_width = 1;
};
/// Throws as most_probable_eye().
ProbableView most_probable_view(const NominalChain& nominal, const EyeLook& look,
                                const BenchDoubt& bench);

/// The eye whose numbers are the most probable by table 5.1 and the look; microscope, image and
/// robot count as known. A scale that is put right at one height is wrong at all others by as much
/// as the chief rays' meeting point is off; which of the eye's numbers makes a magnification what
/// it is, the prior tells in part. Throws std::invalid_argument naming a bad argument, or where no
/// eye explains the look.
Prescription most_probable_eye(const NominalChain& nominal, const EyeLook& look);

/// The belief after such a look in the middle of the retina, about a chain whose eye was made by
/// it; the height is the believed retina's. `reckoned`: of each parameter the variance that
/// the estimate reckoned with, in squares of its sigma; 0 for what it took for known. With ones all
/// of the chain is as well known as prior and look make it; else what was left out stays unknown,
/// and is in what was estimated in its place. Nothing where the look is not shown. Throws
/// std::invalid_argument naming reckoned.
std::optional<ChainBelief> eye_calibrated(const ChainBelief& prior, const EyeLook& look,
                                          const Eigen::VectorXd& reckoned);

}  // namespace vitreo::optics
