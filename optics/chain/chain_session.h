// Measurements of a calibration session of the viewing chain, each with its own uncertainty, and
// the information that they hold.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_doubt.h"

#include <Eigen/Core>

#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::optics {

/// One picture of the robot. What else is known of its place makes it a landing (contact), a place
/// that a side camera saw (known), or a frame of free flight (neither).
struct ChainLook {
  OutlineSeen seen;                // its axis_sigma must be above 0
  Eigen::Vector3d axis;            // believed, unit, nominal eye frame
  double contact_sigma = 0;        // m, above 0: it lies on the retina, but for roughness
  double lying_height = 0;         // m, of its center above the retina where it touches
  Eigen::Vector3d known{0, 0, 0};  // m, nominal eye frame
  /// m, of each coordinate of `known`; infinite: not measured.
  Eigen::Vector3d known_sigma = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
};

/// A vessel's crossing on the retina: the pixel that shows it, and where a picture of the fundus
/// has it (from the eye's axis, m), which turns with the eye.
struct ChainLandmark {
  Eigen::Vector2d pixel_px;
  double sigma_px = 0.5;
  Eigen::Vector2d place;
  double place_sigma = 0.05e-3;  // m, each coordinate
};

/// A parameter measured by itself (keratometry, A-scan, a refractometer, a calibrated microscope):
/// by how much it is off its nominal value, in its own unit, relative where it is.
struct ChainNumber {
  std::string parameter;
  double off = 0;
  double sigma = 0;
};

struct ChainSession {
  std::vector<ChainLook> looks;
  std::vector<ChainLandmark> landmarks;
  std::vector<ChainNumber> numbers;
};

/// Residuals of unit variance of one measurement: by its own unknowns, and by the parameters.
struct ChainBlock {
  Eigen::VectorXd residuals;
  Eigen::MatrixXd by_own;    // place (m) and axis (rad) of a look
  Eigen::MatrixXd by_theta;  // per sigma
};
/// Of a look with the robot at `place`, whose axis is turned by `turned` (rad, along
/// directions_across(look.axis)). Nothing where it is not shown. `derivatives` false: only the
/// residuals.
std::optional<ChainBlock> block_of(const ViewingChain& chain, const ChainLook& look,
                                   const Eigen::Vector3d& position, const Eigen::Vector2d& turned,
                                   bool derivatives);
/// Its own unknowns are the landmark's two coordinates, in m.
std::optional<ChainBlock> block_of(const ViewingChain& chain, const ChainLandmark& landmark,
                                   const Eigen::Vector2d& place);
/// Throws std::invalid_argument naming a parameter that there is not, or a sigma of 0.
ChainBlock block_of(const ViewingChain& chain, const ChainNumber& number);

/// What a block says of the parameters when its own unknowns are free (Schur complement):
///   J2' J2 - J2' J1 (J1' J1)^-1 J1' J2.
Eigen::MatrixXd information_of(const ChainBlock& block);

/// The position that shows the ellipse, by a chain: minimizes the squares weighted by outline and
/// axis, as PositionFit::weighted has it. With a start, from there, else from the depth where the
/// size fits. The axis is where it is believed: the chain's own turn comes to it.
std::optional<Eigen::Vector3d> locate_in_chain(
    const ViewingChain& chain, const OutlineSeen& seen, const Eigen::Vector3d& believed_axis,
    const std::optional<Eigen::Vector3d>& start = std::nullopt);

}  // namespace vitreo::optics
