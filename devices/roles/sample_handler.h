// The role of the sample handler, which brings the robot into the eye: an operator's hands in a
// laboratory, a call in the simulated one.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <string>

namespace vitreo {

class SampleHandler {
 public:
  virtual ~SampleHandler() = default;
  virtual std::string identity() const = 0;
  /// Releases the robot near `position` (m, world frame); where it really ends up is measured by
  /// the cameras.
  virtual void insert_robot(const Eigen::Vector3d& position) = 0;
  virtual void remove_robot() = 0;
};

}  // namespace vitreo
