// Body of two crossed elliptical plates: how thick they are, by the robot's outline and volume.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/robot.h"

namespace vitreo::control {

/// m, of each of two crossed elliptical plates with the robot's outline and volume; 0 where its
/// volume fills the outline. Two elliptical cylinders of pi a b t share a bar of 2 a t^2 along the
/// axis: the smaller root of V = 2 pi a b t - 2 a t^2.
double plate_thickness(const Robot& robot);

/// The same over the robot's width; 1 where it is made of no plates.
double plate_ratio(const Robot& robot);

}  // namespace vitreo::control
