// Buffer of commanded velocities and the motion that they cause behind delay and first-order lag.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstddef>

namespace vitreo::control {

/// Velocities take effect `delay` after their command and then through a first-order `lag` (the
/// coils); each holds until the next. A ring: the newest 1024 are kept, without heap in the loop.
class CommandHistory {
 public:
  /// s, both at least 0; std::invalid_argument naming the one that is not.
  CommandHistory(double delay, double lag);
  /// `time` must not run backwards (std::invalid_argument); one at the same time replaces the last.
  void add(double time, const Eigen::Vector3d& velocity);
  struct Motion {
    Eigen::Vector3d moved{0, 0, 0};     // m
    Eigen::Vector3d velocity{0, 0, 0};  // m/s, at the end, behind the lag
  };
  /// What acted before the first command, m/s: 0, or the fall of a robot whose coils were off.
  void set_before(const Eigen::Vector3d& velocity) { before_ = velocity; }
  /// The motion from time `from` to `to` (s), when the velocity behind the lag was `velocity` (m/s)
  /// at `from`.
  Motion advance(const Eigen::Vector3d& velocity, double from, double to) const;
  /// m/s behind the lag at `time`, from the commands of the twenty lags before it, which must not
  /// be forgotten.
  Eigen::Vector3d velocity_at(double time) const;
  /// s before the time of a velocity_at() for which commands count.
  double memory() const { return 20 * lag_; }
  /// Drops the commands that no advance() from `time` or later needs.
  void forget_before(double time);
  void clear() { size_ = 0; }

 private:
  struct Entry {
    double effect = 0;  // s, when it begins to act
    Eigen::Vector3d velocity{0, 0, 0};
  };
  static constexpr std::size_t kCapacity = 1024;
  const Entry& entry(std::size_t k) const { return ring_[(first_ + k) % kCapacity]; }
  void pass(Motion& motion, const Eigen::Vector3d& commanded, double span) const;

  double delay_;                     // s
  double lag_;                       // s
  Eigen::Vector3d before_{0, 0, 0};  // m/s
  std::array<Entry, kCapacity> ring_;
  std::size_t first_ = 0;
  std::size_t size_ = 0;
};

}  // namespace vitreo::control
