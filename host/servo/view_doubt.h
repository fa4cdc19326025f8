// Doubt of the view: what eye, scale, tilt, robot size and outline do to the positions that the
// loop's localizer finds, by the viewing chain's derivatives.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/rig.h"
#include "optics/analysis/depth_doubt.h"
#include "optics/chain/chain_doubt.h"
#include "vision/ellipse.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace vitreo {

/// rad: how a field holds the robot that is taken to lie along it.
inline constexpr double kTakenAxis = 0.035;

/// m^2, of a position: what stays wrong from frame to frame, everything but the tracker's noise.
struct SystematicDoubt {
  Eigen::Matrix3d whole;
  Eigen::Matrix3d by_attitude;  ///< of it, of axis and outline: another where the robot turns
};

/// What a look at the robot on the retina has put right of the model.
enum class ViewCalibration {
  none,
  scale,  // of its image (thesis 5.4)
  eye,    // the numbers of its eye, by table 5.1 (optics/chain/eye_look)
};

/// m: how well the retina's depth is known; of an eye that is known by table 5.1 alone, by MRI; of
/// one that landings have measured 0, since heights are counted from there.
double retina_sigma(const RigModel& model);

/// Where bench and microscope may stand (model.uncertainty.bench), to first order: what it does to
/// depths that are found by size, and how far it moves a place aside, m, one sigma.
struct BenchShifts {
  std::vector<optics::ViewpointShift> along{};
  double aside = 0;
};
/// Of a measured chain all that is uncertain of it, the robot's size included. Nothing where the
/// view does not show the eye's axis.
BenchShifts bench_shifts(const RigModel& model);

/// What a measured chain leaves, else what the rig says that it does not know of bench, camera and
/// robot (model.uncertainty), and of an eye that is known no better than thesis table 5.1
/// (keep_out.eye) that table too.
class ViewDoubt {
 public:
  /// `calibrated`: the model was put right by one look at the robot on the retina
  /// (scripts/calibration/retina.lua), with its axis along `axis`: what was wrong there is not
  /// wrong there any more, and less elsewhere. Not for a plain view.
  ViewDoubt(const RigModel& model, const Eigen::Vector3d& axis, ViewCalibration calibrated);

  /// At a position that was found from `seen`. `estimated_axis`: the axis was estimated with a
  /// prior of `axis_sigma` (rad), else taken for known (thesis 5.5), though a field turns a robot
  /// no better than that. Nothing where the chain does not show the robot.
  std::optional<SystematicDoubt> systematic(const Eigen::Vector3d& position_in_eye,
                                            const Eigen::Vector3d& axis,
                                            const vision::EllipseMeasurement& seen,
                                            bool estimated_axis, double axis_sigma) const;

  /// Whether positions are found by a measured chain and not by the centered optics.
  bool measured() const { return measured_; }
  /// The position in the nominal eye's frame by the measured chain, near `start`, weighed by
  /// outline and axis. Nothing where that chain does not show it.
  std::optional<Eigen::Vector3d> located(const Eigen::Vector3d& start, const Eigen::Vector3d& axis,
                                         const vision::EllipseMeasurement& seen,
                                         double axis_sigma) const;

 private:
  bool measured_ = false;
  optics::ChainBelief belief_;
  double outline_px_;  // of each semi-axis, from pose to pose
};

}  // namespace vitreo
