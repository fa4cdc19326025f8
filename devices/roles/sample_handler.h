// The role of the sample handler, which puts robot, target and vial where they belong: an
// operator's hands in a laboratory, a call in the simulated one.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <string>

namespace vitreo {

/// Positions are m, world frame. Each call may throw std::invalid_argument naming what there is
/// not, and DeviceError.
class SampleHandler {
 public:
  virtual ~SampleHandler() = default;
  virtual std::string identity() const = 0;
  /// Whether a person does it: the person is asked first, by whoever calls, and the call is made
  /// when the person has said that it is done.
  virtual bool by_hand() const { return false; }
  /// Releases the robot near `position`; where it really ends up is measured by the cameras.
  virtual void insert_robot(const Eigen::Vector3d& position) = 0;
  virtual void remove_robot() = 0;
  /// Sets the calibration's target with its middle at `position`.
  virtual void place_target(const Eigen::Vector3d& position) = 0;
  /// Takes it out of the sight of all cameras.
  virtual void remove_target() = 0;
  /// A vial of a gel ("gel_3"; empty: the fluid) with another robot in it, at rest in the
  /// workspace's middle.
  virtual void change_vial(const std::string& robot, const std::string& gel) = 0;
};

}  // namespace vitreo
