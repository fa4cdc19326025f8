// Protocol that holds a current and a light, and says so: nothing is set again for a minute, so
// only watches can notice anything.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo {

constexpr const char* kHeld = R"(
return { title = "A current and a light that are held", needs = {}, parameters = {},
  run = function(rig, p, run)
    if rig.lamp then rig.lamp:set_level(0.5) end
    if rig.coils then
      local currents = {}
      for i = 1, #rig.coils:currents() do currents[i] = 1 end
      rig.coils:set_currents(currents, { hold = 100 })
    end
    run:wait(60)
  end }
)";

}  // namespace vitreo
