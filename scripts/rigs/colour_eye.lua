-- The eye with a colour camera (thesis 8.3): Bayer filters before the noise, 656 x 490 px of 20.7 um. For what the robot does
-- meanwhile a pose sensor stands in for the operator's hand. The robot is drawn as the ellipsoid that its outline is compared
-- with.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, ms, Hz, A, cSt = units.mm, units.um, units.ms, units.Hz, units.A, units.cSt
local mA, deg = units.mA, units.deg

return {
  title = "Simulated OctoMag with a colour camera",

  model = {
    eye = "model_eye_5_3",
    eye_in_world = { 0, 0, -5 * mm },
    robot = "coni_2mm",
    field = "octomag",
    medium = { name = "silicone oil", density = 970, kinematic_viscosity = 500 * cSt },
  },

  top_camera = {
    driver = "simulated",
    width_px = 656,
    height_px = 490,
    frame_rate = 15 * Hz,
    latency = 80 * ms,
    effective_pixel = 20.7 * um,
    projection = "exact",
    projection_reach = 8 * mm,
    microscope = { numerical_aperture = 0.01, focus = 12.3 * mm },
    sensor = { colour = "bayer", full_well = 20000, read_noise = 15, brightness = 255, vignette = 0.3 },
  },

  coils = {
    driver = "usb3103",
    address = "emulated",
    amperes_per_volt = 2,
    current_limit = 12 * A,
    interlock_total_current = 60 * A,
  },
  pose_sensor = { driver = "simulated", frame_rate = 60 * Hz, latency = 20 * ms, noise = 4 * um },
  sample = { driver = "simulated", placement_scatter = 0 },

  truth = {
    drawn_as = "ellipsoid",
    current_noise = 10 * mA,
    coil_gain_sigma = 0.03,
    coil_position_sigma = 1.2 * mm,
    coil_axis_sigma = 1.5 * deg,
  },
}
