// SPDX-License-Identifier: Apache-2.0
#include "host/session/background.h"

#include "devices/roles/gray.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo {

// The limits: one frame has no scatter to learn from, and 1000 are a minute at 15 Hz.
vision::Background learn_background(Camera& camera, int frames, Time from) {
  if (frames < 2 || frames > 1000) throw std::invalid_argument("frames must be in [2, 1000]");
  vision::Background background;
  while (background.count() < frames) {
    // A camera that misses five frames is lost rather than late: grab() throws.
    const Frame frame = camera.grab(from_seconds(std::max(1.0, 5 * camera.info().frame_period)));
    if (frame.exposed >= from) background.learn(as_gray(frame.image));
  }
  return background;
}

}  // namespace vitreo
