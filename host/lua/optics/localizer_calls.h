// Arguments and results of the localizer's calls.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/optics/bind_optics.h"
#include "optics/pose/object_pose.h"
#include "optics/system/prescriptions.h"

namespace vitreo::lua::localizer_calls {

struct Localizer {
  optics::ObjectPoseSettings settings;
  Eigen::Vector3d offset{0, 0, 0};  // m, of a calibration, added to what is found
  optics::Prescription eye{};       // that the projection was made of
  optics::Microscope microscope{};
  Eigen::Vector3d looked_at{0, 0, 0};  // m, eye frame: where the robot of that look lay
  bool eye_calibrated = false;         // `eye` is the most probable one by a look
  double robot_length = 1;  // factors by which the robot of that look is larger than stated
  double robot_width = 1;
};

struct SeenEllipse {
  optics::EllipseVector ellipse;
  optics::EllipseCovariance covariance;
};

/// A body's fields, and what they say. Throws std::invalid_argument naming the one that is missing
/// or wrong.
Argument body_argument(bool optional = false);
optics::ObjectModel body_at(const OptionTable& table);
/// Without a covariance 0.2 px, or `sigma`, in center and axes, and the angle that goes with it.
SeenEllipse seen_at(const OptionTable& table);
/// The options `body` and `ellipse`. Throws std::invalid_argument as above, or when there is none.
optics::ObjectModel body_option(const Call& call);
SeenEllipse ellipse_option(const Call& call);
/// What is known beforehand; the orientation by nine numbers or by the direction of z.
optics::PoseStart start_at(const OptionTable& how, const Localizer& localizer);
optics::ObjectPoseSettings settings_at(const OptionTable& how, const Localizer& localizer);
/// The option `points`, a list of {body, u, v, sigma}.
std::vector<optics::SeenPoint> points_option(const Call& call);
/// The option `outline`, a list of {u, v, sigma} in order round it.
std::vector<optics::OutlinePoint> outline_option(const Call& call);

/// Makes the status of a pose `misfit` where its chi2, with the outline's own error beside the
/// tracker's, is above what one right ellipse in 200 has. Without a number to spare nothing can be
/// told.
void judge_fit(const optics::ObjectPoseSettings& settings, const SeenEllipse& seen,
               optics::ObjectPose& pose);

/// `position` and `sigma` stand in the result itself only when it was found, so that one
/// of two is not taken for it.
int push_pose(const Call& call, const optics::ObjectPose& pose, const Eigen::Vector3d& offset);
Returned pose_fields();

}  // namespace vitreo::lua::localizer_calls
