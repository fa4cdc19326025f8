// Operator targets: positions for the robot, pointed at in the live view or sent through the
// control socket. They are offered to the script: only a script moves anything.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace vitreo {

/// Any thread.
class OperatorTargets {
 public:
  /// Positions in m, world, to be passed one after the other: they replace what was not taken yet.
  /// Throws std::invalid_argument when the script takes none, for no position or more than 1000, or
  /// one that is not finite.
  void give(std::vector<Eigen::Vector3d> positions) {
    const std::lock_guard lock(mutex_);
    if (!wanted_) throw std::invalid_argument("this protocol takes no targets from the operator");
    if (positions.empty() || positions.size() > 1000)
      throw std::invalid_argument("a path has 1 to 1000 places");
    for (const Eigen::Vector3d& position : positions)
      if (!position.allFinite()) throw std::invalid_argument("a place that is not finite");
    given_ = std::move(positions);
  }
  /// The script's: from its first call on, targets are wanted.
  std::optional<std::vector<Eigen::Vector3d>> take() {
    const std::lock_guard lock(mutex_);
    wanted_ = true;
    return std::exchange(given_, std::nullopt);
  }
  bool wanted() const {
    const std::lock_guard lock(mutex_);
    return wanted_;
  }

 private:
  mutable std::mutex mutex_;
  std::optional<std::vector<Eigen::Vector3d>> given_;
  bool wanted_ = false;
};

}  // namespace vitreo
