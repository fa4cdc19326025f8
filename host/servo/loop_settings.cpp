// SPDX-License-Identifier: Apache-2.0
#include "host/servo/loop_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

/// How far the law estimator may raise the field where nothing else is said, and T, the most.
constexpr double kRaised = 3;
constexpr double kStrongestField = 40e-3;

/// A per coil; 0 for those that are dead by the rig file or by the script.
control::CurrentLimits limits_of(const Rig& rig, const std::vector<int>& dead) {
  control::CurrentLimits limits =
      control::CurrentLimits::Constant(rig.model.field.coils(), rig.coils->current_limit());
  for (const std::vector<int>& list : {rig.model.dead_coils, dead}) {
    for (const int channel : list) {
      if (channel < 1 || channel > limits.size())
        throw std::invalid_argument(fmt::format("dead_coils: there is no coil {}", channel));
      limits[channel - 1] = 0;
    }
  }
  return limits;
}

}  // namespace

ControllerSettings controller_settings(const Rig& rig, const ServoSettings& given, double period) {
  ControllerSettings loop;
  loop.field = given.field;
  loop.axis = given.axis;
  loop.law = given.law;
  loop.gains = given.gains;
  loop.proportional = given.proportional;
  loop.max_speed = given.max_speed;
  loop.velocity = given.velocity;
  loop.limits = limits_of(rig, given.dead_coils);
  loop.total_limit = rig.coils->total_limit();
  loop.period = period;
  loop.tone = given.coil_tone;
  // Without a lens there are no walls to know of.
  loop.wall_drag = given.wall_drag && rig.model.eye.size() > 2;
  loop.field_max = given.field_max.value_or(
      std::max(given.field, std::min(kRaised * given.field, kStrongestField)));
  return loop;
}

control::AttitudeGains attitude_gains(const Rig& rig) {
  control::AttitudeGains gains;
  gains.either_end = !rig.model.robot.hard;
  return gains;
}

RotatingControllerSettings rotating_settings(const Rig& rig, const ServoSettings& given,
                                             double period) {
  RotatingControllerSettings settings;
  settings.law = given.rotating;
  settings.field = given.field;
  settings.axis = given.axis;
  settings.limits.currents = limits_of(rig, given.dead_coils);
  settings.limits.total = rig.coils->total_limit();
  settings.limits.lag = 1 / (2 * M_PI * rig.model.command_bandwidth);
  settings.period = period;
  return settings;
}

const char* source_of(Feedback feedback) {
  switch (feedback) {
    case Feedback::none:
      return "top camera through the eye (no feedback: an operator's eye)";
    case Feedback::one_camera:
      return "top camera through the eye";
    case Feedback::two_cameras:
      return "top camera through the eye and side camera";
    case Feedback::pose_sensor:
      return "pose sensor: the simulator's truth, late and noisy";
    case Feedback::color:
      return "top camera through the eye, by colors and shape";
    case Feedback::color_and_background:
      return "top camera through the eye, by colors and shape or by the background";
  }
  return "?";
}

void check_coils(const Rig& rig) {
  if (rig.coils == nullptr) throw std::invalid_argument("the servo needs the role coils");
  if (rig.coils->channels() != rig.model.field.coils())
    throw std::invalid_argument(
        fmt::format("the field's model has {} coils, the amplifiers have {} channels",
                    rig.model.field.coils(), rig.coils->channels()));
}

}  // namespace vitreo
