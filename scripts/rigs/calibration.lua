-- The rig of the calibration at night: the coils with a teslameter on a stage of three axes, both cameras, and a ball of 0.8
-- mm as the target. Otherwise scripts/rigs/simulated.lua.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, uT = units.mm, units.um, units.uT

return {
  base = "simulated",
  title = "Simulated OctoMag with a field probe on a stage",

  calibrations = { installed = { file = "calibration_rig.json", valid_days = 90 } },

  top_camera = {
    view = "plain", -- "calibrated before introducing the eye model" (5.5)
    width_px = 656,
    height_px = 490,
    effective_pixel = 20.7 * um,
    projection = false, -- without an eye there is none
    microscope = false,
    sensor = { brightness = 200, vignette = 0 },
  },

  stage = { carries = "probe", travel = 20 * mm, max_speed = 20 * mm },
  field_probe = { driver = "simulated", noise = 10 * uT, range = 0.2 },
  sample = { placement_scatter = 0 },

  truth = {
    bodies = {
      target = {
        shape = "spheroid",
        semi_axis = 0.4 * mm,
        semi_radius = 0.4 * mm,
        position = { 0, 0, 0 },
        axis = { 0, 0, 1 },
        fixed = true,
      },
    },
  },

  lens_mover = false,
  pose_sensor = false,
}
