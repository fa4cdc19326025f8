// Trajectories: positions as functions of time, with speed and acceleration limited.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/pd.h"

#include <Eigen/Core>

#include <functional>
#include <vector>

namespace vitreo::control {

struct MotionLimits {
  double speed = 0.5e-3;       // m/s
  double acceleration = 2e-3;  // m/s^2, along and across the path together
  void check() const;          // throws std::invalid_argument naming the limit
};

/// A spiral that widens as it climbs: 6 mm high and 7 mm wide at the top by default, as in the
/// thesis' 5.5.
struct Spiral {
  Eigen::Vector3d bottom{0, 0, -3e-3};  // m, world: the axis' lower end; the axis is world z
  double height = 6e-3;                 // m
  double first_radius = 0.5e-3;         // m, at the bottom
  double last_radius = 3.5e-3;          // m, at the top
  double turns = 4;                     // at most 64
};

/// Starts and ends at rest, in the least time its limits allow along the path (straight parts stop
/// at corners); but for glide(). All of the constructors throw std::invalid_argument naming what is
/// not finite, too short or not above zero.
class Trajectory {
 public:
  static Trajectory hold_at(const Eigen::Vector3d& point);
  /// On at a constant velocity for so long, then at rest: for a place that moves, said anew before
  /// the time is over. Does not start at rest.
  static Trajectory glide(const Eigen::Vector3d& from, const Eigen::Vector3d& velocity,
                          double time);
  static Trajectory line(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                         const MotionLimits& limits);
  /// From the first corner along `side`, then along `up`, and back to where it began.
  static Trajectory rectangle(const Eigen::Vector3d& corner, const Eigen::Vector3d& side,
                              const Eigen::Vector3d& up, const MotionLimits& limits);
  /// Begins at center + `first`, towards `second`: two radii, at a right angle and of one length.
  static Trajectory circle(const Eigen::Vector3d& center, const Eigen::Vector3d& first,
                           const Eigen::Vector3d& second, double turns, const MotionLimits& limits);
  static Trajectory spiral(const Spiral& shape, const MotionLimits& limits);
  /// Straight lines, at rest in every waypoint. Points met twice in a row count once.
  static Trajectory waypoints(const std::vector<Eigen::Vector3d>& points,
                              const MotionLimits& limits);
  /// The natural cubic spline through the points: without rest, and without a jump of the
  /// acceleration.
  static Trajectory spline(const std::vector<Eigen::Vector3d>& points, const MotionLimits& limits);
  /// Any smooth curve over [0, 1].
  static Trajectory curve(const std::function<Eigen::Vector3d(double)>& position,
                          const MotionLimits& limits);

  double duration() const { return knots_.back().time; }    // s
  double length() const { return knots_.back().distance; }  // m
  /// Clamped: before 0 at the start, from the end on the last point, both at rest.
  Reference at(double time) const;

 private:
  struct Knot {
    Eigen::Vector3d position{0, 0, 0};
    Eigen::Vector3d tangent{0, 0, 0};
    double distance = 0;  // m, along the path
    double speed = 0;     // m/s
    double time = 0;      // s
  };
  Trajectory() = default;
  void append(const std::function<Eigen::Vector3d(double)>& position, const MotionLimits& limits);
  void shape_piece(std::size_t first, const MotionLimits& limits,
                   const std::vector<double>& curvature);

  std::vector<Knot> knots_;
};

}  // namespace vitreo::control
