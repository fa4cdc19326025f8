-- The cameras of thesis 5.5, two Basler A602f: an effective pixel of 20.7 um above, 20.4 um at the side (2.07 and 2.04 in print
-- cannot be: the field would be 1.4 mm). Otherwise as scripts/rigs/simulated.lua, with the CoNi robot.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, ms, Hz, A, cSt = units.mm, units.um, units.ms, units.Hz, units.A, units.cSt
local mA, deg = units.mA, units.deg

return {
  title = "Simulated OctoMag of thesis 5.5 with a CoNi robot",

  model = {
    eye = "model_eye_5_3",
    eye_in_world = { 0, 0, -5 * mm },
    robot = "coni_2mm",
    field = "octomag",
    coil_delay = 50 * ms,
    coil_bandwidth = 15 * Hz,
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
    sensor = { full_well = 20000, read_noise = 15, brightness = 255, vignette = 0.3 },
  },

  side_camera = {
    driver = "simulated",
    width_px = 656,
    height_px = 490,
    frame_rate = 15 * Hz,
    latency = 80 * ms,
    effective_pixel = 20.4 * um,
  },

  coils = {
    driver = "usb3103",
    address = "emulated",
    amperes_per_volt = 2,
    current_limit = 12 * A,
    interlock_total_current = 60 * A,
  },

  sample = { driver = "simulated", placement_scatter = 0.3 * mm },

  truth = {
    current_noise = 10 * mA,
    coil_gain_sigma = 0.03,
    coil_position_sigma = 1.2 * mm,
    coil_axis_sigma = 1.5 * deg,
    moment_sigma = 0.05,
    dac_offset_sigma = 2,
  },
}
