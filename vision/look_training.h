// Training of the look memory: looks at disturbed training images, and at anatomy with the object
// masked out; and the audit whether the ground alone is taken for the object.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/object_model.h"

#include <span>

namespace vitreo::vision {

struct KnownObject {
  LabeledImage labeled;
  Ellipse truth;
};

/// Fills `model.looks` and `model.audit`, all else of it being trained.
void learn_looks(ObjectModel& model, std::span<const KnownObject> images,
                 const ObjectViewSettings& view);

}  // namespace vitreo::vision
