// Placing a robot by hand near a wall: some of what is drawn is out of reach, and is drawn anew.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

const char* const kNearTheRetina = R"lua(
local free = require "session.free_drift"
local units = require "units"
local mm, um = units.mm, units.um

return {
  title = "Brought near a wall",
  needs = { "coils", "sample" },
  parameters = { depth = { unit = "mm", default = 4.5 * mm, help = "below the center" } },
  run = function(rig, p, run)
    local servo <close> = rig:servo { feedback = "pose_sensor", law = "estimator" }
    servo:hold(vector(0, 0, 0))
    rig.sample:insert_robot(vector(0, 0, 0))
    servo:wait_until_tracked()
    local lowest = 0
    for number = 1, 8 do
      free.bring(run, rig, servo, { position = vector(0, 0, -p.depth), name = "place " .. number }, { scatter = 1 * mm })
      lowest = math.min(lowest, servo:position()[3])
    end
    run:result("lowest", lowest, "mm")
  end,
}
)lua";

/// At 4.5 mm below the center many of what is drawn is beyond what the margin lets, at 30 mm all
/// is.
TEST(FreeDrift, APlaceThatIsOutOfReachIsDrawnAnewAndNotForEver) {
  const Workplace place;
  place.write("near.lua", kNearTheRetina);
  const Spoken near = place.vitreo("run near.lua depth=4.5mm --quiet");
  EXPECT_EQ(near.exit_code, 0) << near.err;
  const Spoken beyond = place.vitreo("run near.lua depth=30mm --quiet");
  EXPECT_EQ(beyond.exit_code, 1);
  EXPECT_NE(beyond.err.find("is out of reach"), std::string::npos) << beyond.err;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
