// Standstill: a robot that is told to go and is seen in one place, whatever moves it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <deque>

namespace vitreo::control {

/// Held fast, or the view is old: over the shortest span of the last 20 s in which the robot was
/// told to go `least_told` and ten standard deviations of a place, and one and a quarter seconds,
/// it was within noise of one place. One that has lost the field sinks, or drifts, and is not
/// meant.
class Standstill {
 public:
  explicit Standstill(double least_told = 0.4e-3) : least_told_(least_told) {}  // m
  /// `told`: m, what the robot was to move since the last call, behind delay and lag, its sinking
  /// included; `sigma`: m, of a coordinate of the place. A time twice is one,
  /// times that run backwards begin anew.
  void add(double time, const Eigen::Vector3d& place, double sigma, const Eigen::Vector3d& told);
  bool stands() const { return stands_; }
  void reset() { *this = Standstill(least_told_); }

 private:
  struct Seen {
    double time;
    Eigen::Vector3d place;
    double sigma;
    Eigen::Vector3d told;  // m, since the first
  };
  bool look() const;
  double least_told_;
  std::deque<Seen> lately_;
  bool stands_ = false;
};

}  // namespace vitreo::control
