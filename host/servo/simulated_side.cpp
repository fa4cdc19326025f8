// SPDX-License-Identifier: Apache-2.0
#include "host/servo/simulated_side.h"

#include "host/record/meaning.h"

#include <array>
#include <limits>

namespace vitreo {

StreamInfo side_stream(const std::string& source) {
  return {"side_camera",
          source,
          {{"x", "m", "position of the robot", kWorld},
           {"z", "m", "position of the robot", kWorld},
           {"semi_major_px", "px", "longer semi-axis of the robot's ellipse", kSideImage},
           {"semi_minor_px", "px", "shorter semi-axis of the robot's ellipse", kSideImage}},
          kExposure};
}

// The ellipse's axes are NaN, in the tables NULL: no image was rendered that could be measured.
std::unique_ptr<Task> simulate_side(Clock& clock, sim::Laboratory& laboratory, double period,
                                    Recorder& recorder) {
  const int stream =
      recorder.add_stream(side_stream("the simulator's truth, in the side camera's place"));
  return clock.spawn(
      "side camera", [&clock, &laboratory, period = from_seconds(period), &recorder, stream] {
        constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
        for (std::int64_t number = clock.now() / period + 1;; ++number) {
          const Time exposed = number * period;
          clock.sleep_until(exposed);
          const auto truth = laboratory.truth(exposed);
          if (truth)
            recorder.sample(stream, exposed,
                            std::array{truth->position.x(), truth->position.z(), kNone, kNone});
        }
      });
}

}  // namespace vitreo
