-- scripts/rigs/open_vessel.lua with the Ni robot of 0.5 mm, whose weight asks for more current at the boundary than the 60 A in
-- all of the laboratory's rig.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local A = units.A

return {
  base = "open_vessel",
  title = "Simulated OctoMag round a vessel, Ni robot of 0.5 mm",
  model = { robot = "ni_500um" },
  coils = { current_limit = 20 * A, interlock_total_current = 140 * A },
}
