// SPDX-License-Identifier: Apache-2.0
#include "host/loop.h"

#include "control/allocation.h"
#include "optics/pose.h"

#include <cmath>

namespace vitreo {
namespace {

constexpr int kFieldCuts = 4;  // each finds a smaller field; they converge fast

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

}  // namespace

FrameToCurrents::FrameToCurrents(const RigModel& model, vision::Background background, const LoopSettings& settings,
                                 double current_limit)
    : model_(model),
      settings_(settings),
      current_limit_(current_limit),
      tracker_(std::move(background), tracker_settings(model)),
      controller_(settings.gains),
      drag_(control::resistance(model.robot, model.medium, settings.axis)) {
  pose_.projection = model_.projection;
  pose_.exact = model_.exact;
  pose_.image = model_.top_image;
  pose_.robot = {model_.robot.semi_axis, model_.robot.semi_radius};
}

LoopStep FrameToCurrents::step(const cv::Mat& image, double time, const control::Reference& reference,
                               bool servo_position) {
  LoopStep step;
  step.ellipse = tracker_.update(image);
  if (step.ellipse) localise(step);
  if (!step.position) return step;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
  if (servo_position) {
    velocity = controller_.update(time, *step.position, reference);
    step.correction = velocity - reference.velocity;
  } else {
    controller_.reset();
  }
  allocate(step, velocity);
  return step;
}

void FrameToCurrents::localise(LoopStep& step) {
  const optics::EllipseVector observed = step.ellipse->ellipse.vector();
  // The axes of eye and world are parallel.
  const Eigen::Vector3d axis = settings_.axis;
  if (!last_in_eye_) last_in_eye_ = optics::first_guess(pose_, observed, axis);
  if (!last_in_eye_) return;
  const auto pose = optics::locate(pose_, observed, step.ellipse->covariance, axis, *last_in_eye_);
  if (!pose) {
    last_in_eye_.reset();  // the next frame starts afresh
    return;
  }
  last_in_eye_ = pose->position_in_eye;
  step.position = pose->position_in_eye + model_.eye_in_world;
  step.covariance = pose->covariance;
  step.residual_px = pose->residual_px;
}

void FrameToCurrents::allocate(LoopStep& step, const Eigen::Vector3d& velocity) {
  const control::FieldMatrix matrix = model_.field.matrix(*step.position);
  const Eigen::Vector3d levitation = Eigen::Vector3d(0, 0, model_.robot.net_weight(model_.medium)) + trim_;
  control::Allocation allocation;
  double field = settings_.field;
  // A soft robot's moment falls with its field: where a limit cuts the field, ask again with what is left of the
  // moment.
  for (int attempt = 0; attempt < kFieldCuts; ++attempt) {
    const Eigen::Vector3d moment = model_.robot.moment(field) * settings_.axis;
    allocation =
        control::allocate(matrix, moment, {field * settings_.axis, levitation, drag_ * velocity}, current_limit_);
    if (allocation.field_scale >= 1) break;
    field *= allocation.field_scale;
  }
  step.currents = allocation.currents;
  step.force_scale = allocation.force_scale;
}

control::Currents FrameToCurrents::orienting_currents() const {
  const Eigen::Vector3d moment = model_.robot.moment(settings_.field) * settings_.axis;
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  return control::allocate(model_.field.matrix(none), moment, {settings_.field * settings_.axis, none, none},
                           current_limit_)
      .currents;
}

}  // namespace vitreo
