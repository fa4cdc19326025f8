// Side view of the robot: place and direction from the ellipse that the side camera shows.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/rig.h"
#include "host/servo/side_observation.h"
#include "vision/ellipse.h"

namespace vitreo {

/// The side view is orthographic (thesis 5.5): m = pixel * (image - center), covariance J C J'.
SideObservation side_observation(const RigModel& model, Time exposed,
                                 const vision::EllipseMeasurement& seen);

}  // namespace vitreo
