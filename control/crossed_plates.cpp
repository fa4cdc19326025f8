// SPDX-License-Identifier: Apache-2.0
#include "control/crossed_plates.h"

#include <cmath>

namespace vitreo::control {

double plate_thickness(const Robot& robot) {
  const double flat = 2 * M_PI * robot.semi_axis * robot.semi_radius;
  const double root = flat * flat - 8 * robot.semi_axis * robot.solid_volume;
  return root > 0 ? (flat - std::sqrt(root)) / (4 * robot.semi_axis) : 0;
}

double plate_ratio(const Robot& robot) {
  const double thickness = plate_thickness(robot);
  const bool plates = robot.shape == BodyShape::crossed_plates && thickness > 0;
  return plates ? thickness / (2 * robot.semi_radius) : 1;
}

}  // namespace vitreo::control
