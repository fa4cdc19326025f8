// Wall watch: whether a robot is inside the keep-out margin, or pushed against a wall that its
// position does not show.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/clearance.h"

#include <Eigen/Core>

#include <deque>

namespace vitreo {

/// One turn of the loop in which the robot was seen.
struct WallSight {
  double time = 0;  // s, of the exposure
  control::Clearance clearance;
  Eigen::Vector3d position{0, 0, 0};  // m, world
  Eigen::Vector3d target{0, 0, 0};    // m, the reference then
  bool kept_out = false;              // the margin has limited the command
};

class WallWatch {
 public:
  explicit WallWatch(double margin) : margin_(margin) {}

  struct Verdict {
    bool inside = false;   // of the margin, for longer than a disturbance that is corrected takes
    bool pressed = false;  // it is told to come nearer to the nearest wall, and does not
    bool lying = false;    // it has touched a wall, as far as is known, for long
  };
  Verdict see(const WallSight& sight);
  void forget();  // a new goal

  // Of `inside`: the margin's hysteresis, m, and s.
  static constexpr double kHysteresis = 50e-6;
  static constexpr double kBriefly = 0.5;
  // Of `lying`: m, and s. What lifts a robot off a wall takes a second or two.
  static constexpr double kTouches = 20e-6;
  static constexpr double kLies = 5;
  // Of `pressed`: nearer to a wall than, m; the error left towards it, m; moved less than, m; all
  // of it within, s. A loop that lags, or droops by less, is no push.
  static constexpr double kNear = 1e-3;
  static constexpr double kError = 0.2e-3;
  static constexpr double kStill = 20e-6;
  static constexpr double kLong = 1.5;

 private:
  struct Moment {
    double time;
    double along;  // m, of the position along the wall's normal
  };
  double margin_;
  bool inside_ = false;
  double outside_at_ = -1e9;  // s, when it was last outside of the margin
  double off_at_ = -1e9;      // s, when it last touched no wall
  bool seen_ = false;
  std::deque<Moment> pushing_;  // while it is told to come nearer
  bool lens_ = false;           // of that wall
};

}  // namespace vitreo
