// SPDX-License-Identifier: Apache-2.0
#include "host/servo/view_doubt.h"

#include "host/rig/measured_chain.h"
#include "optics/chain/eye_look.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace vitreo {
namespace {

/// px, of the outline of crossed plates against the ellipsoid's: common to all frames, and what is
/// left from pose to pose (docs/figures.md). A measured chain has its own of both.
constexpr double kCommonOutline_px = 0.15;
constexpr double kChangingOutline_px = 0.1;

/// px, of a mean of two seconds of frames on the retina.
constexpr double kLook_px = 0.05;

optics::ChainSigmas sigmas_of(const BenchUncertainty& bench) {
  optics::ChainSigmas sigmas = optics::ChainSigmas::none();
  sigmas.pixel = bench.pixel;
  sigmas.microscope_tilt = bench.microscope_tilt;
  sigmas.pupil_power = bench.pupil_power;
  sigmas.object_plane = bench.object_plane;
  sigmas.center = bench.center;
  sigmas.lens_axial = bench.lens_axial;
  sigmas.lens_aside = bench.lens_aside;
  sigmas.lens_tilt = bench.lens_tilt;
  sigmas.eye_rotation = bench.eye_rotation;
  sigmas.inner_lens_aside = bench.inner_lens_aside;
  sigmas.inner_lens_tilt = bench.inner_lens_tilt;
  sigmas.axial_length = bench.axial_length;
  sigmas.retina_depth = bench.retina_depth;
  sigmas.retina_curvature = bench.retina_curvature;
  return sigmas;
}

// What the rig file says of its own knowledge. Two errors of pixel and tilt add up: that of camera
// or stand, and that of the bench.
optics::ChainSigmas sigmas_of(const RigModel& model, ViewCalibration calibrated) {
  const ViewUncertainty& known = model.uncertainty;
  optics::ChainSigmas sigmas = sigmas_of(known.bench);
  // A loop that has its eye from a look does not count it as known, whatever the rig says.
  if (model.keep_out.eye_uncertain || calibrated == ViewCalibration::eye)
    sigmas.eye = optics::table_5_1();
  sigmas.retina_depth = retina_sigma(model);
  sigmas.pixel = std::hypot(known.pixel, known.bench.pixel);
  sigmas.robot_size = known.size;
  sigmas.microscope_tilt = std::hypot(known.tilt, known.bench.microscope_tilt);
  sigmas.dilation_px = kCommonOutline_px;
  return sigmas;
}

// The variances that scripts/calibration/retina.lua has the look reckon with: table 5.1, the
// camera's pixel and the robot's size.
Eigen::VectorXd reckoned_with(const optics::ChainBelief& belief, const ViewUncertainty& known) {
  Eigen::VectorXd reckoned = Eigen::VectorXd::Zero(belief.chain.size());
  const auto table = optics::applicable(optics::table_5_1(), belief.chain.nominal().prescription);
  for (Eigen::Index i = 0; i < reckoned.size(); ++i) {
    const optics::ChainParameter& one = belief.chain.parameters()[static_cast<std::size_t>(i)];
    const bool of_table = std::any_of(
        table.begin(), table.end(), [&one](const auto& row) { return row.parameter == one.name; });
    if (of_table || one.name == "robot_length" || one.name == "robot_width") reckoned[i] = 1;
    if (one.name == "pixel") reckoned[i] = std::pow(known.pixel / one.sigma, 2);
  }
  return reckoned;
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

// A look on the retina puts the centered optics right, not a measured chain.
ViewDoubt::ViewDoubt(const RigModel& model, const Eigen::Vector3d& axis, ViewCalibration calibrated)
    : measured_(model.chain && calibrated == ViewCalibration::none),
      belief_(measured_ ? model.chain->belief
                        : optics::prior_belief(nominal_chain(model), sigmas_of(model, calibrated))),
      outline_px_(measured_ ? model.chain->outline_px : kChangingOutline_px) {
  const bool has_pixel = model.uncertainty.pixel > 0 || model.uncertainty.bench.pixel > 0;
  const bool scale = calibrated == ViewCalibration::scale && has_pixel;
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
                     : optics::eye_calibrated(belief_, {outline, axis, lying},
                                              reckoned_with(belief_, model.uncertainty));
  if (after) belief_ = std::move(*after);
}

std::optional<SystematicDoubt> ViewDoubt::systematic(const Eigen::Vector3d& position_in_eye,
                                                     const Eigen::Vector3d& axis,
                                                     const vision::EllipseMeasurement& seen,
                                                     bool estimated_axis, double axis_sigma) const {
  const optics::OutlineSeen outline{seen.ellipse.vector(), seen.covariance, outline_px_,
                                    estimated_axis ? axis_sigma : kTakenAxis};
  const auto doubt = optics::position_doubt(
      belief_, {position_in_eye, axis, seen.ellipse.center_px}, outline,
      estimated_axis || measured_ ? optics::PositionFit::weighted : optics::PositionFit::thesis);
  if (!doubt) return std::nullopt;
  return SystematicDoubt{doubt->covariance - doubt->tracker, doubt->noise - doubt->tracker};
}

std::optional<Eigen::Vector3d> ViewDoubt::located(const Eigen::Vector3d& start,
                                                  const Eigen::Vector3d& axis,
                                                  const vision::EllipseMeasurement& seen,
                                                  double axis_sigma) const {
  const optics::OutlineSeen outline{seen.ellipse.vector(), seen.covariance, outline_px_,
                                    axis_sigma > 0 ? axis_sigma : kTakenAxis};
  return optics::locate_in_chain(belief_.chain, outline, axis, start);
}

double retina_sigma(const RigModel& model) {
  constexpr double kByMri = 0.3e-3;  // m (thesis 4.3)
  const double known = model.uncertainty.bench.retina_depth;
  if (model.chain) return model.chain->touched ? 0 : known;
  return model.keep_out.eye_uncertain ? std::max(known, kByMri) : known;
}

/// Of a robot that lies along x over the retina's middle, in two heights: the shifts are linear.
BenchShifts bench_shifts(const RigModel& model) {
  constexpr std::array<double, 2> kHeights{1e-3, 9e-3};  // m
  const optics::ChainBelief belief =
      model.chain ? model.chain->belief
                  : optics::prior_belief(nominal_chain(model), sigmas_of(model.uncertainty.bench));
  // Independent shifts: C = L L'.
  const Eigen::MatrixXd apart = belief.covariance.llt().matrixL();
  std::array<Eigen::Matrix3Xd, 2> moved;
  for (std::size_t k = 0; k < 2; ++k) {
    const optics::RobotPlace place{{0, 0, kHeights[k]}, {1, 0, 0}, model.top_image.center_px};
    const vision::EllipseMeasurement seen = outline_at(belief.chain, place);
    if (!(seen.ellipse.semi_major_px > 0)) return {};
    const auto doubt = optics::position_doubt(
        belief, place, {seen.ellipse.vector(), seen.covariance}, optics::PositionFit::thesis);
    if (!doubt) return {};
    moved[k] = doubt->by_theta * apart;
  }
  // A depth that is off by a + b z is that of a viewpoint v + dv and a scale 1 + s with b = -s and
  // a = v s - dv (optics/analysis/depth_doubt).
  BenchShifts found;
  for (Eigen::Index i = 0; i < belief.chain.size(); ++i) {
    const double slope = (moved[1](2, i) - moved[0](2, i)) / (kHeights[1] - kHeights[0]);
    const double at_zero = moved[0](2, i) - slope * kHeights[0];
    if (slope != 0 || at_zero != 0)
      found.along.push_back({-slope * model.projection.viewpoint - at_zero, -slope});
  }
  for (const Eigen::Matrix3Xd& one : moved)
    found.aside = std::max(found.aside, std::sqrt(one.topRows<2>().squaredNorm() / 2));
  return found;
}

}  // namespace vitreo
