// World: the plant of the simulated laboratory. Coils that lag and warm, a robot that turns,
// drifts, sinks and touches, and other bodies that it can push, in the fluid or gel of the eye.
// Integrated lazily in steps of 1 ms, up to the latest time asked for. World frame, SI.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_model.h"
#include "control/robots.h"
#include "control/vitreous.h"
#include "devices/sim/body.h"
#include "devices/sim/coil_bank.h"
#include "devices/sim/robot_motion.h"
#include "devices/time/clock.h"

#include <Eigen/Core>

#include <optional>
#include <random>
#include <vector>

namespace vitreo::sim {

/// What is really there; every number may differ from what the controller believes.
struct WorldSettings {
  control::FieldModel field = control::CoilField::octomag();
  control::Robot robot = control::coni_2mm();
  double moment_gain = 1;  // true moment / the robot's nominal moment
  control::Medium medium;
  std::optional<control::Gel> gel;  // instead of the medium
  CoilBankSettings coils;
  Cavity cavity;
  bool wall_drag = true;              // Faxen's factors near retina and lens
  double friction = 0.3;              // on the retina and the walls, and between bodies
  double placement_scatter = 0.3e-3;  // m, of the hand that inserts the robot, per axis
  double roll = 0;                    // rad, of the inserted robot's plates about its axis
  Eigen::Vector3d flow{0, 0, 0};      // m/s: convection of the fluid, which carries the bodies
  // N, on the robot: what is left of hand tuning, see Laboratory
  Eigen::Vector3d extra_force{0, 0, 0};
  std::vector<BodySettings> bodies;  // besides the robot
  void check() const;                // throws std::invalid_argument naming the parameter
};

class World {
 public:
  World(const WorldSettings& settings, std::uint64_t seed);
  /// New set-points of the amplifiers, A; they act from `time` + delay on. Times must not run
  /// backwards.
  void set_coil_commands(Time time, const control::Currents& commands);
  /// The amplifiers' heartbeat line (CoilBank::set_line).
  void set_enable_line(Time time, bool high) { coils_.set_line(time, high); }
  /// Part of a coil's current (from 1) that makes field from `time` on (CoilBank::set_response).
  void set_coil_response(Time time, int coil, double part);
  void insert_robot(Time time, const Eigen::Vector3d& near);
  void remove_robot(Time time);
  /// Puts a body (counted as in the settings, from 0) somewhere else. Throws std::out_of_range
  /// without such a body.
  void place_body(Time time, std::size_t index, const Eigen::Vector3d& position);
  /// Null when no robot is in the eye. Throws std::out_of_range for times before the history (1 s)
  /// that is kept.
  const BodyState* robot(Time time);
  /// The other bodies, in the settings' order. Throws as robot().
  const std::vector<BodyState>& bodies(Time time);
  /// A, as they flow; K, the coils.
  const control::Currents& currents(Time time);
  const control::Currents& coil_temperatures(Time time);
  /// T and T/m, of the coils at the currents that flow, and the background.
  control::FieldGradient field(Time time, const Eigen::Vector3d& position);
  /// Whether the field was last asked for outside the region for which a calibration holds; there
  /// it goes on from the nearest position inside with the gradient of that position.
  bool beyond_calibration() const { return beyond_calibration_; }
  const WorldSettings& settings() const { return settings_; }

 private:
  struct Moment {  // the state at the end of one step
    bool present;
    BodyState robot;
    std::vector<BodyState> others;
  };
  void advance_to(Time time);
  void step();
  void move_robot();
  void move_others();
  void push_apart();
  void keep_all_inside();
  void remember();
  control::FieldGradient field_at(const Eigen::Vector3d& position,
                                  const control::Currents& currents);
  std::pair<const Moment*, const Moment*> moments_about(Time time);

  WorldSettings settings_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  CoilBank coils_;
  RobotMotion motion_;
  std::int64_t steps_ = 0;  // of 1 ms, done
  bool beyond_calibration_ = false;
  // the state, and as it was at the step's start
  Moment now_;
  Moment before_;
  Eigen::Vector3d turned_{0, 0, 0};
  // of the other bodies: m/s, m/(N s)
  std::vector<double> sinking_;
  std::vector<double> mobility_;
  std::vector<Moment> history_;  // a ring: step k at k modulo its size
  BodyState asked_robot_;
  std::vector<BodyState> asked_bodies_;
};

}  // namespace vitreo::sim
