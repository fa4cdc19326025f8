-- The simulated microscope of the sampled bench without an eye below it, and a ball of 0.8 mm on a stage as the target: what a
-- calibration of the microscope alone sees (docs/chain.md). With a run's seed it is the microscope that sampled_bench has with
-- it.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm = units.mm

return {
  base = "simulated",
  title = "Simulated microscope on a target",

  calibrations = { installed = { file = "microscope_target.json", valid_days = 90 } },

  top_camera = {
    view = "plain",
    projection = false, -- without an eye there is none
    sensor = { brightness = 200, vignette = 0 },
  },

  sample = { placement_scatter = 0 },

  truth = {
    machine = "sampled",
    optics = { bench = "sampled" },
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
