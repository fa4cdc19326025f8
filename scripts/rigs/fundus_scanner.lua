-- The miniature ophthalmoscope of thesis appendix A: a small sensor in the aerial image, decentred, on a stage along the axis and
-- on one that turns it about the axis.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, ms, Hz, cSt = units.mm, units.um, units.ms, units.Hz, units.cSt

return {
  title = "Simulated ophthalmoscope with a turning sensor",

  model = {
    eye = "model_eye_5_3",
    eye_in_world = { 0, 0, -5 * mm },
    robot = "coni_2mm",
    medium = { name = "silicone oil", density = 970, kinematic_viscosity = 500 * cSt },
  },

  top_camera = {
    driver = "simulated",
    view = "bare_sensor",
    width_px = 330,
    height_px = 360,
    centre_px = { 30, 180 }, -- the axis is at the sensor's rim
    frame_rate = 30 * Hz,
    latency = 30 * ms,
    effective_pixel = 9.9 * um,
    microscope = { focus = 12 * mm }, -- where the stage's zero is, from the last lens
    sensor_aperture = 0.08, -- of the lens before this sensor; the eye's own pupil would give 0.14 on the axis
    sensor = { full_well = 20000, read_noise = 15, brightness = 200, vignette = 0 },
  },

  stage = { driver = "simulated", carries = "sensor", travel = 12 * mm, max_speed = 20 * mm },
  rotation_stage = { driver = "simulated", max_speed = 3 },

  sample = { driver = "simulated" },
}
