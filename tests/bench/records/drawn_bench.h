// Drawn bench: a simulated laboratory's optics off what its rig believes, with pictures of a robot
// that is put anywhere by hand. No loop, no clock.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "devices/sim/renderer.h"
#include "host/rig/rig.h"
#include "host/rig/rig_settings.h"
#include "vision/background.h"

#include <Eigen/Core>

#include <cstdint>

namespace vitreo::records {

/// What is drawn of the bench.
struct BenchKind {
  bool sampled = true;         // eye's place, lens, microscope, retina: truth.optics.bench
  bool perturbed_eye = false;  // off by thesis table 5.1, and the rig says that it may be
};

class DrawnBench {
 public:
  DrawnBench(const BenchKind& kind, std::uint64_t seed);
  /// What the rig believes.
  const RigModel& model() const { return model_; }
  vision::Background background();
  /// A CoNi robot of the plant's size at `place` (m, world) along `axis` (unit, world), one plate
  /// level. `gray`: without noise of its own if the same twice.
  cv::Mat picture(const Eigen::Vector3d& place, const Eigen::Vector3d& axis);
  /// Where a robot lies on the true retina's middle, m, world.
  Eigen::Vector3d on_the_retina() const;
  /// Where a side camera has it, whose scale and turn are drawn: x and z; y as it is.
  Eigen::Vector3d by_side_camera(const Eigen::Vector3d& place) const;
  double size() const { return size_; }  // factor
  const sim::LaboratorySettings& truth() const { return truth_; }

 private:
  sim::Renderer renderer();

  RigModel model_;
  sim::LaboratorySettings truth_;
  double size_ = 1;
  double side_scale_ = 1, side_turn_ = 0;  // of what the camera shows over what there is; rad
  sim::Renderer renderer_;
  std::uint64_t frame_ = 0;
};

}  // namespace vitreo::records
