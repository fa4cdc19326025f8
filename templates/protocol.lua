-- @NAME@: its purpose in one line. Then its steps, in order, as the operator should know them.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, s = units.mm, units.s

return {
  title = "@NAME@",
  needs = { "top_camera", "coils" }, -- roles that the rig must have
  parameters = {
    wait = { default = 1 * s, min = 0 * s, max = 60 * s, unit = "s", help = "how long to look at each place" },
    places = { default = 3, min = 1, max = 20, integer = true, help = "how many places" },
  },

  ---@param rig vitreo.rig
  ---@param run vitreo.run
  run = function(rig, p, run)
    local coils_off = {}
    for coil = 1, #rig.coils:currents() do
      coils_off[coil] = 0
    end
    run:defer(function() rig.coils:set_currents(coils_off) end) -- however it ends

    for place in run:each(p.places, "place") do
      run:checkpoint("before place " .. place) -- pauses take effect here
      local frame = rig.top_camera:grab()
      run:record("frames", { number = frame.number, offset = place * 1 * mm }, { offset = "m" })
      run:wait(p.wait)
    end
    run:result("places", p.places)
  end,
}
