// SPDX-License-Identifier: Apache-2.0
#include "host/observers.h"

#include "vision/blob_tracker.h"

#include <array>
#include <cmath>

namespace vitreo {

std::unique_ptr<Task> observe_truth(Clock& clock, sim::Laboratory& laboratory, double period, Recorder& recorder) {
  const int stream =
      recorder.add_stream({"truth",
                           "the simulator's truth, which the loop never sees",
                           {{"x", "m"}, {"y", "m"}, {"z", "m"}, {"axis_x", ""}, {"axis_y", ""}, {"axis_z", ""}}});
  return clock.spawn("truth", [&clock, &laboratory, period = from_seconds(period), &recorder, stream] {
    for (std::int64_t number = clock.now() / period + 1;; ++number) {
      const Time exposed = number * period;
      clock.sleep_until(exposed);
      const auto truth = laboratory.truth(exposed);
      if (!truth) continue;
      const Eigen::Vector3d &p = truth->position, &a = truth->axis;
      recorder.sample(stream, exposed, std::array{p.x(), p.y(), p.z(), a.x(), a.y(), a.z()});
    }
  });
}

std::unique_ptr<Task> observe_side(Clock& clock, Rig& rig, vision::Background background, Recorder& recorder) {
  const int stream = recorder.add_stream({"side_camera",
                                          "the side camera's view, orthographic",
                                          {{"x", "m"}, {"z", "m"}, {"semi_major_px", ""}, {"semi_minor_px", ""}}});
  return clock.spawn("side camera", [&rig, &recorder, stream, learnt = std::move(background)] {
    vision::BlobTracker tracker(learnt, {});
    const RigModel& model = rig.model;
    while (true) {
      const Frame frame = rig.side_camera->grab(from_seconds(5));
      const auto seen = tracker.update(frame.image);
      if (!seen) continue;
      const Eigen::Vector2d away = seen->ellipse.centre_px - model.side_centre_px;
      recorder.sample(stream, frame.exposed,
                      std::array{away.x() * model.side_pixel, -away.y() * model.side_pixel, seen->ellipse.semi_major_px,
                                 seen->ellipse.semi_minor_px});
    }
  });
}

}  // namespace vitreo
