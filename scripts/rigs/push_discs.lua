-- A robot and a disc on the floor of the eye, seen from above without optics by a colour camera (thesis 8.3.1); the pose sensor
-- stands in for the operator's hand.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, ms, Hz, A, cSt = units.mm, units.um, units.ms, units.Hz, units.A, units.cSt
local mA = units.mA

return {
  title = "Simulated OctoMag, colour camera from above, one disc",

  model = {
    eye = "model_eye_5_3",
    eye_in_world = { 0, 0, -5 * mm },
    robot = "coni_2mm",
    field = "octomag",
    medium = { name = "silicone oil", density = 970, kinematic_viscosity = 500 * cSt },
  },

  top_camera = {
    driver = "simulated",
    view = "plain",
    width_px = 400,
    height_px = 300,
    frame_rate = 15 * Hz,
    latency = 80 * ms,
    effective_pixel = 24 * um,
    microscope = { numerical_aperture = 0.01 },
    sensor = { colour = "bayer", full_well = 20000, read_noise = 15, brightness = 200, vignette = 0 },
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
    bodies = {
      disc = {
        shape = "disc",
        semi_axis = 0.3 * mm,
        semi_radius = 0.5 * mm,
        position = { 0.4 * mm, 0, -4.65 * mm },
        axis = { 0, 0, 1 },
        density = 1200,
        colour = { 0.9, 0.2, 0.05 },
      },
    },
  },
}
