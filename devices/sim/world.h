// The plant of the simulated laboratory: coils that lag, a robot that drifts, sinks and touches, in the fluid of the
// eye. It integrates lazily, in steps of 1 ms, up to the latest time that anybody has asked about. World frame, SI.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/robot.h"
#include "devices/clock.h"

#include <Eigen/Core>

#include <deque>
#include <random>
#include <vector>

namespace vitreo::sim {

/// What is really there; every number may differ from what the controller believes.
struct WorldSettings {
  control::CoilField field = control::CoilField::octomag();
  control::Robot robot = control::coni_2mm();
  double moment_gain = 1;  // true moment / the robot's nominal moment
  control::Medium medium;
  double coil_bandwidth = 15;                 // Hz, first order (facts/magnetics 1.1)
  double coil_delay = 50e-3;                  // s, from a new set-point to the first change of current
  double current_noise = 10e-3;               // A, standard deviation per coil and step
  Eigen::Vector3d eye_in_world{0, 0, -5e-3};  // m: the retina's vertex
  double retina_radius = 11.5e-3;             // m
  double lens_depth = 15.5e-3;                // m, from the retina's vertex to the lens above the cavity
  double friction = 0.3;                      // on the retina and the walls
  double placement_scatter = 0.3e-3;          // m, of the hand that inserts the robot, per axis
  void check() const;                         // throws std::invalid_argument naming the parameter
};

/// Where a body is and how it lies.
struct BodyState {
  Eigen::Vector3d position;       // m, world
  Eigen::Vector3d axis;           // unit
  double semi_axis, semi_radius;  // m
};

class World {
 public:
  World(const WorldSettings& settings, std::uint64_t seed);
  /// New set-points of the amplifiers, A; they act from `time` + delay on. Times must not run backwards.
  void set_coil_commands(Time time, const control::Currents& commands);
  void insert_robot(Time time, const Eigen::Vector3d& near);
  void remove_robot(Time time);
  /// Null when no robot is in the eye. Throws std::out_of_range for times before the history (0.5 s) that is kept.
  const BodyState* robot(Time time);
  /// A, as they flow.
  const control::Currents& currents(Time time);
  const WorldSettings& settings() const { return settings_; }

 private:
  struct Command {
    Time acts_from;
    control::Currents currents;
  };
  struct Moment {  // the state at the end of one step
    bool present;
    BodyState body;
  };
  void advance_to(Time time);
  void step();
  void move_robot();
  void keep_inside(Eigen::Vector3d& velocity_step);

  WorldSettings settings_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  std::int64_t steps_ = 0;  // of 1 ms, done
  std::deque<Command> commands_;
  control::Currents target_, currents_;
  bool present_ = false;
  BodyState body_;
  std::deque<Moment> history_;  // the last entry is the state now
  BodyState answer_;
};

}  // namespace vitreo::sim
