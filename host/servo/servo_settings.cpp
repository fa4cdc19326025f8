// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo {

const char* to_string(Feedback feedback) {
  constexpr const char* kNames[] = {"none",        "one_camera", "two_cameras",
                                    "pose_sensor", "color",      "color_and_background"};
  return kNames[static_cast<std::size_t>(feedback)];
}

Feedback feedback_named(const std::string& name) {
  for (const Feedback feedback :
       {Feedback::none, Feedback::one_camera, Feedback::two_cameras, Feedback::pose_sensor,
        Feedback::color, Feedback::color_and_background})
    if (name == to_string(feedback)) return feedback;
  throw std::invalid_argument(
      "feedback: wants \"none\", \"one_camera\", \"two_cameras\", \"pose_sensor\", \"color\" or "
      "\"color_and_background\", got \"" +
      name + "\"");
}

// rad. The thesis' law takes the commanded axis for the robot's; with the estimator it is uncertain
// unless the settings say otherwise.
double ServoSettings::axis_uncertainty() const {
  // How far coils of the prior's kind (3 %, 1.2 mm, 1.5 degrees each) turn the true field: 1.8
  // degrees rms in the median machine, 4.6 in the worst, more while a large force is made.
  constexpr double kAxisSigma = 4 * M_PI / 180;
  return axis_sigma.value_or(law == ControlLaw::estimator ? kAxisSigma : 0);
}

ClearanceBelief ServoSettings::clearance_belief() const {
  // rad, at least: the worst of those machines, whatever a law takes the axis for.
  constexpr double kLeastAxisSigma = 4.6 * M_PI / 180;
  ClearanceBelief belief;
  belief.axis = axis;
  belief.axis_sigma = std::max(axis_uncertainty(), kLeastAxisSigma);
  belief.through_eye = feedback != Feedback::pose_sensor || by_pose;
  belief.calibrated = view.corrects();
  belief.looked_at = view.looked_at;
  return belief;
}

// Throws std::invalid_argument naming the setting and its bounds.
void ServoSettings::check() const {
  if (!(field >= 1e-3 && field <= 40e-3))
    throw std::invalid_argument("field must be in [1 mT, 40 mT]");
  if (field_max && !(*field_max >= field && *field_max <= 40e-3))
    throw std::invalid_argument("field_max must be in [field, 40 mT]");
  if (!(std::abs(axis.norm() - 1) < 1e-6))
    throw std::invalid_argument("axis must be a unit vector");
  if (!(coil_tone >= 0 && coil_tone <= 2))
    throw std::invalid_argument("coil_tone must be in [0, 2] A");
  if (!(lost_timeout > 0 && lost_timeout <= 10))
    throw std::invalid_argument("lost_timeout must be in (0, 10] s");
  gains.check();
  if (proportional && !(*proportional >= 0))
    throw std::invalid_argument("proportional: must be at least 0 1/s");
  if (axis_sigma && !(*axis_sigma >= 0 && *axis_sigma < 1))
    throw std::invalid_argument("axis_uncertainty: must be in [0, 1) rad");
  if (max_speed && !(*max_speed > 0)) throw std::invalid_argument("max_speed: must be above 0 m/s");
  velocity.check();
  rotating.check();
  // End over end it shows the top camera another outline in each frame, and no depth.
  if (law == ControlLaw::rotating && rotating.mode == control::RotatingMode::tumbler &&
      looks(feedback))
    throw std::invalid_argument(
        "feedback: a tumbling robot's depth is not in the camera's image; use \"pose_sensor\"");
  if (!(view.image_scale > 0.1 && view.image_scale < 10))
    throw std::invalid_argument("view: image scale of a tenth to ten");
  if (!view.offset.allFinite()) throw std::invalid_argument("view: offset must be finite");
  for (const int channel : dead_coils)
    if (channel < 1) throw std::invalid_argument("dead_coils: channels count from 1");
}

// By samples in time, as the path will be driven. The same shape of the eye as in
// ServoController::drag_at. A robot that lies on the retina is found behind it where the bench is
// not the believed one: until the path has once come inside it may not go farther out, and after
// that never outside.
void check_reach(const RigModel& model, const control::Trajectory& path,
                 const std::optional<Eigen::Vector3d>& robot) {
  constexpr int kAsked = 200;       // positions along the way
  constexpr double kHere = 0.5e-3;  // m, from where the robot is found: the path begins there
  // Surfaces count from 1 at the retina, as in the thesis' tables: the second is the lens' rear.
  const double radius = model.eye.surfaces.front().radius;
  const double lens = model.eye.vertex(2);
  const bool begins_here = robot && (path.at(0).position - *robot).norm() < kHere;
  double before = begins_here ? std::numeric_limits<double>::infinity() : 0;  // m, outside
  for (int i = 0; i <= kAsked; ++i) {
    const Eigen::Vector3d position = path.at(path.duration() * i / kAsked).position;
    const auto refuse = [&position](const char* why) {
      throw std::invalid_argument(fmt::format("({:.2f}, {:.2f}, {:.2f}) mm is out of reach: {}",
                                              position.x() * 1e3, position.y() * 1e3,
                                              position.z() * 1e3, why));
    };
    if (!position.allFinite()) refuse("it is not a place");
    if (!model.field.valid_at(position)) refuse("outside the region of the field's model");
    if (position.z() - model.eye_in_world.z() > lens) refuse("behind the lens");
    // The retina's sphere below its equator, and above it a cylinder of the same radius: there the
    // distance from the center is taken horizontally.
    Eigen::Vector3d from_center = position - model.eye_in_world - Eigen::Vector3d(0, 0, radius);
    from_center.z() = std::min(from_center.z(), 0.0);
    const double outside = std::max(from_center.norm() - radius, 0.0);
    const bool comes_in = outside <= before && i < kAsked;
    if (outside > 0 && !comes_in) refuse("outside the retina");
    before = std::min(before, outside);
  }
}

}  // namespace vitreo
