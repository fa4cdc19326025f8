// Motion watch: a loop whose robot goes to and fro about its target, stands although it is told to
// move, or does not come to its target. By position and target alone.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <deque>

namespace vitreo::control {

/// s, within which a command catches a robot that sinks, after a loop's begin or a fall.
constexpr double kCaught = 2.5;

/// One turn of a loop.
struct WatchedMotion {
  double time = 0;                    // s, of the measurement
  Eigen::Vector3d position{0, 0, 0};  // m, measured
  Eigen::Vector3d error{0, 0, 0};     // m, from the target of that time
  Eigen::Vector3d wanted{0, 0, 0};    // m/s: reference and feedback, without what cancels a push
  double sigma = 0;                   // m, of one coordinate
  // What is commanded on purpose, and stirs a loop that is sound: the target's own velocity, m/s,
  // and how fast the axis is turned, rad/s.
  Eigen::Vector3d reference{0, 0, 0};
  double turning = 0;
  bool free = true;  // it goes where it is told: not in a medium that yields now and then
};

/// The last ten seconds, looked at every half second; of the axis' turns five more.
class MotionWatch {
 public:
  /// A time twice is one, times that run backwards begin anew.
  void add(const WatchedMotion& now);
  /// In some coordinate the error's autocorrelation over the last three seconds and more is below
  /// -0.5 at half a period and above 0.4 at a whole one, each of the newest three periods has its
  /// part of it, and the error is larger than noise and than what a sound loop makes of a target
  /// that goes to and fro and of an axis that turns: a limit cycle, or a loop at its margin. The
  /// error and not a filter's innovations: a filter that is right predicts an oscillation that the
  /// gains make.
  bool oscillating() const { return oscillating_; }
  double period() const { return period_; }        // s, of the oscillation
  double amplitude() const { return amplitude_; }  // m
  /// Over the last two seconds the robot was told to go `kTold` m and more and went less than a
  /// fifth of it.
  bool standing() const { return standing_; }
  /// For three seconds it has been farther than 2 mm from its target, and has come nearer by less
  /// than 0.3 mm.
  bool off_target() const { return off_target_; }
  /// m: how far it has been, in the mean, from a target that rested for three seconds, where that
  /// was more than 0.2 mm throughout and it came no nearer by a fifth: what a law leaves standing.
  /// Else 0.
  double rests_off() const { return rests_off_; }
  void reset() { *this = MotionWatch(); }

 private:
  void look();
  bool stands() const;
  bool stays_away(double away, double nearer) const;
  double stays_off_rest() const;
  bool oscillates(int axis, std::size_t count, double sound);
  static constexpr double kTold = 0.4e-3;
  std::deque<WatchedMotion> lately_;
  double looked_ = -1e9;  // s
  bool oscillating_ = false;
  bool standing_ = false;
  bool off_target_ = false;
  double rests_off_ = 0;
  double period_ = 0;
  double amplitude_ = 0;
};

}  // namespace vitreo::control
