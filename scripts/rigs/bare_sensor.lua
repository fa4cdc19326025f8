-- The bench of thesis chapter 4 and appendix A: a bare sensor of 9.9 um pixels in the aerial image of the model eye, on a
-- stage along the axis and on one that turns it, and a target with dots that a second stage moves (on the simulated rig:
-- rig.simulation:move_body). The sensor is as wide as all positions together at which the thesis' own was held.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, ms, Hz, cSt = units.mm, units.um, units.ms, units.Hz, units.cSt

return {
  title = "Simulated bench with a bare sensor behind the condensing lens",

  model = {
    eye = "model_eye_5_3",
    eye_in_world = { 0, 0, -5 * mm },
    robot = "coni_2mm",
    medium = { name = "silicone oil", density = 970, kinematic_viscosity = 500 * cSt },
  },

  top_camera = {
    driver = "simulated",
    view = "bare_sensor",
    width_px = 1760,
    height_px = 160,
    frame_rate = 30 * Hz,
    latency = 30 * ms,
    effective_pixel = 9.9 * um,
    microscope = { focus = 12 * mm }, -- where the stage's zero is, from the last lens
    sensor_aperture = 0.12, -- within the eye's pupil, 0.14 seen from here, whose rim rays are lost
    sensor = { full_well = 20000, read_noise = 15, brightness = 200, vignette = 0 },
  },

  stage = { driver = "simulated", carries = "sensor", travel = 12 * mm, max_speed = 20 * mm },
  rotation_stage = { driver = "simulated", max_speed = 3 },

  sample = { driver = "simulated" },

  truth = {
    bodies = {
      target = {
        shape = "disc",
        semi_axis = 20 * um,
        semi_radius = 0.6 * mm,
        position = { 0, 0, 0 },
        axis = { 0, 0, 1 },
        fixed = true,
        dotted = true,
        dot_pitch = 0.15 * mm,
        color = { 1, 1, 1 },
      },
    },
  },
}
