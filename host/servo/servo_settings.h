// Settings of the servo loop: feedback, control law, view and limits, with their bounds; and the
// reach of a path.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/trajectory.h"
#include "host/rig/rig.h"
#include "host/servo/robot_clearance.h"
#include "host/servo/rotating_law.h"
#include "host/servo/servo_controller.h"

#include <Eigen/Core>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// Source of the robot's position (thesis 6.1). none: the top camera, as an operator's eye, only
/// while a position is to be reached; a robot that is released has the constant currents of the
/// position where the trim was found. pose_sensor: the simulator's truth, late and noisy; only a
/// simulated rig has one. All by what differs from a learnt background, but color: the top camera,
/// by learnt colors and shape (thesis 8); color_and_background: by the one of both that sees
/// better.
enum class Feedback { none, one_camera, two_cameras, pose_sensor, color, color_and_background };
const char* to_string(Feedback feedback);
/// Whether the loop sees the robot by the top camera.
constexpr bool looks(Feedback feedback) {
  return feedback != Feedback::none && feedback != Feedback::pose_sensor;
}
constexpr bool needs_colors(Feedback feedback) {
  return feedback == Feedback::color || feedback == Feedback::color_and_background;
}
constexpr bool needs_background(Feedback feedback) {
  return feedback != Feedback::pose_sensor && feedback != Feedback::color;
}
/// Throws std::invalid_argument with the names there are.
Feedback feedback_named(const std::string& name);

/// Another eye than the rig file's, with its projection; and by which factors the robot is larger
/// than the file has it.
struct CorrectedEye {
  optics::System system;
  optics::SingleViewpoint projection;
  std::optional<optics::ExactProjection> exact{};
  double robot_length = 1;
  double robot_width = 1;
};

/// What a calibration on the known retina (thesis 6.2) changed of the rig's view.
struct ViewCorrection {
  double image_scale = 1;           // of the aerial image's m per pixel
  Eigen::Vector3d offset{0, 0, 0};  // m, added to the position found
  /// The most probable one. Shared: settings are copied, and a projection is a large table.
  std::shared_ptr<const CorrectedEye> eye{};
  Eigen::Vector3d looked_at{0, 0, 0};  // m, eye frame: where the robot lay then
  /// Whether anything is corrected: then the robot was seen on the retina, and a measured chain,
  /// which holds the optics otherwise, is done without.
  bool corrects() const { return image_scale != 1 || !offset.isZero() || eye; }
};

struct ServoSettings {
  double field = 10e-3;  // T, magnitude of the field, the law estimator's least
  /// T: the law estimator may raise the field so far, where that asks less of the coils. Nothing:
  /// three times the field, and 40 mT at most.
  std::optional<double> field_max{};
  Eigen::Vector3d axis{1, 0, 0};  // the robot's axis wanted, unit, world
  Feedback feedback = Feedback::one_camera;
  ControlLaw law = ControlLaw::pd;
  control::PdGains gains;                // of the law pd
  std::optional<double> proportional{};  // 1/s, of the law estimator; nothing: tuned
  std::optional<double> max_speed{};     // m/s, likewise, of the feedback alone
  control::VelocityGains velocity;       // of the law velocity
  RotatingSettings rotating;             // of the law rotating
  std::vector<int> dead_coils;           // channels from 1, besides the rig's own
  /// A, of the law estimator: amplitude of the currents that tell a weak coil (ControllerSettings).
  double coil_tone = 0.6;
  /// s without a measurement before the loop lets go: zero current until it is given a goal again.
  double lost_timeout = 1.0;
  /// rad, standard deviation of the robot's axis about the commanded field; 0: it lies along the
  /// field, as in the thesis. Nothing: 0, but of the law estimator kAxisSigma.
  std::optional<double> axis_sigma{};
  bool wall_drag = true;  // ControllerSettings, where the rig's eye has walls
  /// The robot may touch retina and lens: no keep-out margin, for what is pushed along the retina.
  bool may_touch = false;
  /// A dry run: the pose sensor in the camera's place, and with each position the ellipse that the
  /// camera would show.
  bool by_pose = false;
  /// A dry run of feedback by cameras: a path must stay in the top camera's sight all the same.
  bool stays_in_sight = false;
  double axis_uncertainty() const;           // rad, as chosen or as the law has it
  ClearanceBelief clearance_belief() const;  // of attitude and view, as the loop has them
  void check() const;                        // throws std::invalid_argument naming the setting
  ViewCorrection view;                       // of the rig's own view
};

/// Throws std::invalid_argument naming the position where the robot cannot be taken: outside the
/// field model's region, the retina or the lens. `robot`: where it is found, m, world; from there
/// it may be brought in, though it be behind the believed retina.
void check_reach(const RigModel& model, const control::Trajectory& path,
                 const std::optional<Eigen::Vector3d>& robot = std::nullopt);

}  // namespace vitreo
