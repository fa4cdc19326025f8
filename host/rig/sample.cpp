// SPDX-License-Identifier: Apache-2.0
#include "host/rig/sample.h"

#include "control/robots.h"
#include "control/vitreous.h"

namespace vitreo {

std::string RigSample::identity() const {
  return by_hand_ ? "the operator's hands" : simulated_->identity();
}

void RigSample::insert_robot(const Eigen::Vector3d& position) {
  if (simulated_ != nullptr) simulated_->insert_robot(position);
}

void RigSample::remove_robot() {
  if (simulated_ != nullptr) simulated_->remove_robot();
}

void RigSample::place_target(const Eigen::Vector3d& position) {
  if (simulated_ != nullptr) simulated_->place_target(position);
}

void RigSample::remove_target() {
  if (simulated_ != nullptr) simulated_->remove_target();
}

void RigSample::change_vial(const std::string& robot, const std::string& gel) {
  // Both names are looked up before anything changes, also where a person changes the vial.
  const control::Robot other = control::robot_named(robot);
  if (!gel.empty()) control::gel_named(gel);
  if (simulated_ != nullptr) simulated_->change_vial(robot, gel);
  model_.robot = other;
}

}  // namespace vitreo
