// Sample of a rig: what is done to it by a person or in the simulated laboratory, and what the rig
// believes of it afterwards.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/sample_handler.h"
#include "host/rig/rig.h"

namespace vitreo {

class RigSample final : public SampleHandler {
 public:
  /// `simulated`: what acts on the simulated laboratory; null where everything is real, and a
  /// person does all of it. `model` learns of another robot. Both are borrowed.
  RigSample(SampleHandler* simulated, RigModel& model, bool by_hand)
      : simulated_(simulated), model_(model), by_hand_(by_hand) {}
  std::string identity() const override;
  bool by_hand() const override { return by_hand_; }
  void insert_robot(const Eigen::Vector3d& position) override;
  void remove_robot() override;
  void place_target(const Eigen::Vector3d& position) override;
  void remove_target() override;
  void change_vial(const std::string& robot, const std::string& gel) override;

 private:
  SampleHandler* const simulated_;
  RigModel& model_;
  const bool by_hand_;
};

}  // namespace vitreo
