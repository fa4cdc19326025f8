-- The cameras of thesis 5.5, two Basler A602f: an effective pixel of 20.7 um above, 20.4 um at the side (the printed 2.07 and
-- 2.04 are impossible: the field would be 1.4 mm). Otherwise as scripts/rigs/simulated.lua, with the CoNi robot.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um = units.mm, units.um

return {
  base = "simulated",
  title = "Simulated OctoMag of thesis 5.5 with a CoNi robot",

  top_camera = {
    width_px = 656,
    height_px = 490,
    effective_pixel = 20.7 * um,
    projection = "exact",
    projection_reach = 8 * mm,
  },

  -- What that bench had not.
  lens_mover = false,
  stage = false,
  pose_sensor = false,
}
