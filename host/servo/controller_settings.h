// Settings of the servo controller: its law, its mode, what it follows and what limits it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/box_allocation.h"
#include "control/pd.h"
#include "control/trajectory.h"
#include "control/velocity_control.h"

#include <Eigen/Core>

#include <optional>
#include <string>

namespace vitreo {

/// pd: the thesis' (6.2). estimator: Kalman filter, prediction over the loop's latency, disturbance
/// compensated. velocity: for media that yield and spring back (7.3). rotating: of
/// RotatingController.
enum class ControlLaw { pd, estimator, velocity, rotating };
const char* to_string(ControlLaw law);
/// Throws std::invalid_argument with the names there are; rotating has none.
ControlLaw control_law_named(const std::string& name);

/// follow: to the reference. cancel: only the disturbance is compensated (estimator only). leave:
/// field and levitation computed where the robot is, its position left alone. constant: the one set
/// of currents of the position where the trim was found. off: none; the robot sinks, and the law
/// estimator reckons with that.
enum class ControlMode { follow, cancel, leave, constant, off };

/// A trajectory and when it begins.
struct ReferencePath {
  control::Trajectory path = control::Trajectory::hold_at(Eigen::Vector3d::Zero());
  double begin = 0;  // s
  control::Reference at(double time) const { return path.at(time - begin); }
};

struct ControllerSettings {
  double field = 10e-3;  // T
  double field_max = 0;  // T: the law estimator may raise the field so far; 0: it does not
  // Unit, world: the commanded field's direction, taken as the robot's.
  Eigen::Vector3d axis{1, 0, 0};
  ControlLaw law = ControlLaw::pd;
  control::PdGains gains;  // of pd
  // Of estimator, 1/s and m/s (of the feedback alone); nothing: tuned from latency, drag, weight
  // and instability, and scheduled by what is known of the loop.
  std::optional<double> proportional{};
  std::optional<double> max_speed{};
  control::VelocityGains velocity;                                          // of velocity
  control::CurrentLimits limits = control::CurrentLimits::Constant(8, 12);  // A; 0 for a dead coil
  double total_limit = 60;                                                  // A, sum of magnitudes
  double period = 1 / 15.0;  // s, between measurements
  // Faxen's factors for retina and lens, where the robot is; else the free drag everywhere.
  bool wall_drag = false;
  // A, each coil's share before it is taken into the allocation's null space: what tells a dead
  // coil (FieldAllocator::tone), of the law estimator. 0: none.
  double tone = 0;
};

}  // namespace vitreo
