// Direction path: the robot's axis as a function of time, turned at a limited rate.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <vector>

namespace vitreo::control {

/// Great arcs between directions, each run through at a smooth rate (3 s^2 - 2 s^3 of its angle).
class DirectionPath {
 public:
  static DirectionPath hold(const Eigen::Vector3d& direction);
  /// From one direction to the next at no more than `rate` rad/s. Opposite ones have no arc between
  /// them: std::invalid_argument, as for what is no direction, and a rate not above 0.
  static DirectionPath through(const std::vector<Eigen::Vector3d>& directions, double rate);
  /// At these times (s, rising, the first 0), one for each direction.
  static DirectionPath timed(const std::vector<Eigen::Vector3d>& directions,
                             const std::vector<double>& times);
  double duration() const { return knots_.back().time; }  // s
  /// Unit; clamped to the first and the last.
  Eigen::Vector3d at(double time) const;
  const Eigen::Vector3d& last() const { return knots_.back().direction; }
  /// rad/s, the fastest on the way.
  double fastest() const;

 private:
  struct Knot {
    double time;
    Eigen::Vector3d direction;
  };
  std::vector<Knot> knots_;
};

}  // namespace vitreo::control
