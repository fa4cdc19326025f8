-- An OctoMag round a vessel of silicone oil without an eye, for the whole workspace of 20 mm: the middle of the model's cavity
-- is put at the center, and a pose sensor sees the robot everywhere (protocols/drift_orientations, after Kummer 2010).
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm = units.mm

return {
  base = "simulated",
  title = "Simulated OctoMag round a vessel",
  model = { eye_in_world = { 0, 0, -11.5 * mm } },
  top_camera = false,
  side_camera = false,
  lens_mover = false,
  stage = false,
}
