// Robot eyes: the ways in which a servo loop sees the robot in the top camera's picture, by what
// differs from a learnt background or by learnt colors and shape, behind one interface.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/rig.h"
#include "vision/background.h"
#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>
#include <vector>

namespace vitreo::vision {
struct TrackedObject;
}

namespace vitreo {

class RobotEye {
 public:
  virtual ~RobotEye() = default;
  virtual const char* name() const = 0;
  /// The robot's outline in the next picture as the camera gave it (8 bits, gray or color), with
  /// its covariance; nothing where the eye is not sure of it.
  virtual std::optional<vision::EllipseMeasurement> look(const cv::Mat& picture) = 0;
  /// What it saw is not the robot: the next picture is searched as a whole.
  virtual void forget() = 0;
  /// Share of the rim that must be in line with the ellipse for it to be believed.
  virtual double least_rim() const = 0;
};

/// Background subtraction (vision::BlobTracker), with the blur that the rig's microscope leads to
/// expect. Wants a ground and a light that stay as they were learnt.
std::unique_ptr<RobotEye> background_eye(const RigModel& model, vision::Background background);

/// Colors and shape (vision::MultiTracker): the first object is the robot, the others are known
/// bodies that it is not. A gray camera's pictures count as colors without hue.
std::unique_ptr<RobotEye> color_eye(const std::vector<vision::TrackedObject>& objects);

}  // namespace vitreo
