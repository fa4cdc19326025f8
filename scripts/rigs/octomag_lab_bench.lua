-- The laboratory of octomag_lab as it is calibrated: without the eye, the camera straight on the workspace ("calibrated before
-- introducing the eye model", thesis 5.5), and the teslameter on the stage in the camera's place.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local um = units.um

return {
  base = "octomag_lab",
  title = "OctoMag laboratory, on the bench without the eye",

  top_camera = {
    view = "plain",
    width_px = 656,
    height_px = 490,
    effective_pixel = 20.7 * um, -- of the scene
  },

  stage = { carries = "probe" },
  field_probe = { on_stage = true },
}
