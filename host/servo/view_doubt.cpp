// SPDX-License-Identifier: Apache-2.0
#include "host/servo/view_doubt.h"

#include "optics/chain/eye_look.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo {
namespace {

/// px, of the outline of crossed plates against the ellipsoid's: common to all frames, and what is
/// left from pose to pose (docs/figures.md).
constexpr double kCommonOutline_px = 0.15;
constexpr double kChangingOutline_px = 0.1;

/// px, of a mean of two seconds of frames on the retina.
constexpr double kLook_px = 0.05;

// The believed chain, its scale as a calibration has put it right.
optics::NominalChain chain_of(const RigModel& model) {
  optics::NominalChain chain;
  chain.prescription = optics::prescription(model.eye_name);
  chain.prescription.system = model.eye;
  chain.microscope = model.microscope;
  chain.image = model.top_image;
  chain.robot = {model.robot.semi_axis, model.robot.semi_radius};
  return chain;
}

// What the rig file says of its own knowledge; where it says nothing of the eye, the eye counts as
// known. Where lens and microscope stand is not among the rig's keys yet.
optics::ChainSigmas sigmas_of(const RigModel& model) {
  constexpr double kRetinalDepth = 0.3e-3;  // m, by MRI (thesis 4.3)
  const ViewUncertainty& known = model.uncertainty;
  optics::ChainSigmas sigmas = optics::ChainSigmas::none();
  sigmas.pixel = known.pixel;
  sigmas.robot_size = known.size;
  sigmas.microscope_tilt = known.tilt;
  sigmas.dilation_px = kCommonOutline_px;
  if (!model.keep_out.eye_uncertain) return sigmas;
  sigmas.eye = optics::table_5_1();
  sigmas.retina_depth = kRetinalDepth;
  return sigmas;
}

// What the look on the retina must have been, by the belief: the loop is told the scale that it
// led to and not the look itself. An empty one where the retina's middle is not shown.
vision::EllipseMeasurement outline_at(const optics::ViewingChain& chain,
                                      const optics::RobotPlace& place) {
  vision::EllipseMeasurement seen{};
  const auto shown = optics::shown_ellipse(chain, place);
  if (!shown) return seen;
  const optics::EllipseVector ellipse = optics::ellipse_from(*shown);
  seen.ellipse = {ellipse.head<2>(), ellipse[2], ellipse[3], ellipse[4]};
  const double difference = std::max(ellipse[2] - ellipse[3], 1.0);
  seen.covariance = kLook_px * kLook_px * optics::EllipseCovariance::Identity();
  seen.covariance(4, 4) = kLook_px * kLook_px / (difference * difference);
  return seen;
}

}  // namespace

ViewDoubt::ViewDoubt(const RigModel& model, const Eigen::Vector3d& axis, ViewCalibration calibrated)
    : belief_(optics::prior_belief(chain_of(model), sigmas_of(model))) {
  const bool scale = calibrated == ViewCalibration::scale && model.uncertainty.pixel > 0;
  if (!scale && calibrated != ViewCalibration::eye) return;
  const bool upright = std::abs(axis.z()) > 0.7;
  const double lying = upright ? model.robot.semi_axis : model.robot.semi_radius;
  const optics::RobotPlace place{{0, 0, lying}, axis, model.top_image.center_px};
  const vision::EllipseMeasurement seen = outline_at(belief_.chain, place);
  if (!(seen.ellipse.semi_major_px > 0)) return;
  const optics::OutlineSeen outline{seen.ellipse.vector(), seen.covariance, kChangingOutline_px,
                                    kTakenAxis};
  auto after = scale ? optics::scale_calibrated(belief_, {place, outline, 0, true},
                                                optics::PositionFit::thesis)
                     : optics::eye_calibrated(belief_, {outline, axis, lying});
  if (after) belief_ = std::move(*after);
}

std::optional<SystematicDoubt> ViewDoubt::systematic(const Eigen::Vector3d& position_in_eye,
                                                     const Eigen::Vector3d& axis,
                                                     const vision::EllipseMeasurement& seen,
                                                     bool estimated_axis, double axis_sigma) const {
  const optics::OutlineSeen outline{seen.ellipse.vector(), seen.covariance, kChangingOutline_px,
                                    estimated_axis ? axis_sigma : kTakenAxis};
  const auto doubt = optics::position_doubt(
      belief_, {position_in_eye, axis, seen.ellipse.center_px}, outline,
      estimated_axis ? optics::PositionFit::weighted : optics::PositionFit::thesis);
  if (!doubt) return std::nullopt;
  return SystematicDoubt{doubt->covariance - doubt->tracker, doubt->noise - doubt->tracker};
}

}  // namespace vitreo
