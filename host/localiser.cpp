// SPDX-License-Identifier: Apache-2.0
#include "host/localiser.h"

#include "optics/pose.h"

#include <Eigen/LU>

#include <cmath>
#include <utility>

namespace vitreo {
namespace {

/// The tracker is told about how blurred the microscope's image is at the ends of the workspace; it finds the rest
/// itself, from 0.4 to 2.5 times this.
vision::BlobTrackerSettings tracker_settings(const RigModel& model) {
  constexpr double kWavelength = 550e-9;       // m
  constexpr double kGreatestDefocus = 3.5e-3;  // m of aerial image, over a workspace focused at its middle
  const double aperture = model.microscope.numerical_aperture, pixel = model.top_image.pixel;
  const double diffraction = 0.21 * kWavelength / aperture;  // the Airy pattern's nearest Gaussian
  const double disc = aperture * kGreatestDefocus / 2;       // of a disc: half its radius
  vision::BlobTrackerSettings settings;
  settings.blur_sigma_px = 0.8 * std::sqrt(diffraction * diffraction + disc * disc + pixel * pixel / 12) / pixel;
  return settings;
}

/// What no tracker's covariance knows, the errors of contour and pose, is not below a tenth of a pixel.
constexpr double kModelError_px = 0.1;

constexpr double kEye = 30e-3;  // m, from the retina's vertex: more than any eye is long

}  // namespace

Localiser::Localiser(const RigModel& model, vision::Background background, const Eigen::Vector3d& axis)
    : model_(model), axis_(axis), tracker_(std::move(background), tracker_settings(model)) {
  pose_.projection = model_.projection;
  pose_.exact = model_.exact;
  pose_.image = model_.top_image;
  pose_.robot = {model_.robot.semi_axis, model_.robot.semi_radius};
}

Sighting Localiser::look(const cv::Mat& image) {
  Sighting sighting;
  sighting.ellipse = tracker_.update(image);
  if (sighting.ellipse) localise(sighting);
  return sighting;
}

void Localiser::localise(Sighting& sighting) {
  const optics::EllipseVector observed = sighting.ellipse->ellipse.vector();
  // The axes of eye and world are parallel.
  if (!last_in_eye_) last_in_eye_ = optics::first_guess(pose_, observed, axis_);
  if (!last_in_eye_) return;
  const auto pose = optics::locate(pose_, observed, sighting.ellipse->covariance, axis_, *last_in_eye_);
  // A residual may have a minimum far outside, where no robot can be: of 1e6 m, for one outline cut by the image's
  // edge.
  if (!pose || !(pose->position_in_eye.norm() < kEye)) {
    last_in_eye_.reset();  // the next frame starts afresh
    return;
  }
  last_in_eye_ = pose->position_in_eye;
  sighting.position = pose->position_in_eye + model_.eye_in_world;
  const double error = kModelError_px * model_.top_image.pixel;
  sighting.covariance = pose->covariance + error * error * Eigen::Matrix3d::Identity();
  sighting.residual_px = pose->residual_px;
}

void join_side(Sighting& sighting, const SideSighting& side) {
  if (!sighting.position) return;
  Eigen::Matrix<double, 2, 3> sees;
  sees << 1, 0, 0, 0, 0, 1;
  const Eigen::Matrix3d before = sighting.covariance;
  const Eigen::Matrix2d innovation = sees * before * sees.transpose() + side.covariance;
  const Eigen::Matrix<double, 3, 2> gain = before * sees.transpose() * innovation.inverse();
  if (!gain.allFinite()) return;
  *sighting.position += gain * (side.place - sees * *sighting.position);
  const Eigen::Matrix3d left = Eigen::Matrix3d::Identity() - gain * sees;
  // Joseph's form: stays symmetric and positive.
  sighting.covariance = left * before * left.transpose() + gain * side.covariance * gain.transpose();
}

}  // namespace vitreo
