-- The rig as it is calibrated at night: the coils with a teslameter on a stage of three axes, both cameras, and a ball of 0.8 mm
-- as the target. Otherwise scripts/rigs/simulated.lua.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, uT, ms, Hz, A, cSt = units.mm, units.um, units.uT, units.ms, units.Hz, units.A, units.cSt
local mA, deg = units.mA, units.deg

return {
  title = "Simulated OctoMag with a field probe on a stage",

  calibrations = { installed = { file = "calibration_rig.json", valid_days = 90 } },

  model = {
    eye = "model_eye_5_3",
    eye_in_world = { 0, 0, -5 * mm },
    robot = "coni_2mm",
    field = "octomag",
    medium = { name = "silicone oil", density = 970, kinematic_viscosity = 500 * cSt },
  },

  top_camera = {
    driver = "simulated",
    view = "plain", -- "calibrated before introducing the eye model" (5.5)
    width_px = 656,
    height_px = 490,
    frame_rate = 15 * Hz,
    latency = 80 * ms,
    effective_pixel = 20.7 * um,
    sensor = { full_well = 20000, read_noise = 15, brightness = 200, vignette = 0 },
  },

  side_camera = { driver = "simulated", frame_rate = 15 * Hz, latency = 80 * ms, effective_pixel = 20.4 * um },

  coils = {
    driver = "usb3103",
    address = "emulated",
    amperes_per_volt = 2,
    current_limit = 12 * A,
    interlock_total_current = 60 * A,
  },
  stage = { driver = "simulated", carries = "probe", travel = 20 * mm, max_speed = 20 * mm },
  field_probe = { driver = "simulated", noise = 10 * uT, range = 0.2 },
  sample = { driver = "simulated", placement_scatter = 0 },

  truth = {
    coil_delay = 50 * ms,
    coil_bandwidth = 15 * Hz,
    current_noise = 10 * mA,
    coil_gain_sigma = 0.03,
    coil_position_sigma = 1.2 * mm,
    coil_axis_sigma = 1.5 * deg,
    dac_offset_sigma = 2,
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
}
