// Total uncertainty of a position that was located from one ellipse: outline noise, axis, eye and
// calibration, and whether the ellipse fits the chain at all.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_ellipse.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::optics {

/// What is known of a chain: its parameters' most probable values, about which it is linearized,
/// and their covariance, in units of the sigmas beforehand. Before any measurement 0 and the
/// identity.
struct ChainBelief {
  ViewingChain chain;
  Eigen::MatrixXd covariance;
};
ChainBelief prior_belief(const NominalChain& nominal, const ChainSigmas& sigmas);

/// What was seen, and how the position was made of it.
struct OutlineSeen {
  EllipseVector ellipse;
  EllipseCovariance covariance;  // of the tracker
  double contour_sigma_px = 0;   // of each semi-axis: the outline is not quite the model's
  double axis_sigma = 0;         // rad, in each direction across the axis
};
enum class PositionFit {
  weighted,  // by the covariance, the axis' uncertainty included
  thesis,    // by (5.15), the angle's weight 0.1
};

/// Covariances of the position, m^2, that add up to `covariance`. Eye and calibration are shares of
/// what the chain's parameters do: each part's covariance with their sum. Where parts were measured
/// only together a share may be negative.
struct PositionDoubt {
  Eigen::Matrix3d covariance;
  Eigen::Matrix3d noise;    // of outline and axis: a new frame has another
  Eigen::Matrix3d tracker;  // of it, what the tracker's covariance alone makes
  Eigen::Matrix3d eye;
  Eigen::Matrix3d calibration;
  /// Of the height above the retina where it was touched, m^2, with its noise part. The retina's
  /// depth is what the absolute z does not know and this does not need.
  double height_variance = 0;
  double height_noise = 0;
  /// Weighted squares that no position explains, of 2 degrees of freedom (5 numbers, 3 unknown).
  double chi2 = 0;
  Eigen::Matrix<double, 3, Eigen::Dynamic> by_theta;  // m per sigma of the parameter
};

/// At a position that was found, `place.position`, with the axis as it is believed. `touched`:
/// where the robot lay on the retina, x and y. Nothing where the chain does not show the robot or a
/// direction is not observed. Throws std::invalid_argument naming a bad covariance.
std::optional<PositionDoubt> position_doubt(const ChainBelief& belief, const RobotPlace& place,
                                            const OutlineSeen& seen, PositionFit fit,
                                            const Eigen::Vector2d& touched = {0, 0});

/// Covariance of an outline's smooth coordinates, px^2, contour error included and axis not.
Eigen::Matrix<double, 5, 5> smooth_covariance(const OutlineSeen& seen);

/// A chi2 of a right ellipse is above this in one of 200 frames.
inline constexpr double kMisfitChi2 = 10.6;

/// A look at the robot at a height that was known, by which the image's scale was put right
/// (PoseCalibration): the chain's pixel takes up whatever was wrong at that look.
struct ScaleLook {
  RobotPlace place;
  OutlineSeen seen;
  double known_z_sigma = 0;  // m, of the known height
  bool on_retina = true;     // the height is the believed retina's: its doubts are the height's
};
/// The belief after such a calibration. The parameters' other values stay. Nothing where the look
/// is not shown or says nothing of the scale. Throws std::invalid_argument when the chain's pixel
/// is held.
std::optional<ChainBelief> scale_calibrated(const ChainBelief& before, const ScaleLook& look,
                                            PositionFit fit);

/// z of the retina at (x, y), by the chain's parameters, without the nominal sphere, and d z / d
/// theta.
double retina_offset(const ViewingChain& chain, const Eigen::Vector2d& at);
Eigen::RowVectorXd retina_derivative(const ViewingChain& chain, const Eigen::Vector2d& at);
/// z of the nominal retina.
double nominal_retina(const ViewingChain& chain, const Eigen::Vector2d& at);

}  // namespace vitreo::optics
