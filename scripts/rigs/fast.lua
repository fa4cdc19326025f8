-- How fast a loop can be: the simulated laboratory with a pose sensor of 200 readings a second, amplifiers of 50 Hz without
-- transport delay, and no camera. For judging control alone (protocols/hold with feedback = "pose_sensor").
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, ms, Hz, A, cSt = units.mm, units.um, units.ms, units.Hz, units.A, units.cSt
local mA, deg = units.mA, units.deg

return {
  title = "Simulated OctoMag with a fast pose sensor",

  model = {
    eye = "model_eye_5_3",
    eye_in_world = { 0, 0, -5 * mm },
    robot = "coni_2mm",
    field = "octomag",
    coil_delay = 0,
    coil_bandwidth = 50 * Hz,
    medium = { name = "silicone oil", density = 970, kinematic_viscosity = 500 * cSt },
  },

  coils = {
    driver = "usb3103",
    address = "emulated",
    amperes_per_volt = 2,
    current_limit = 12 * A,
    interlock_total_current = 60 * A,
  },

  pose_sensor = { driver = "simulated", frame_rate = 200 * Hz, latency = 8 * ms, noise = 0.1 * 5 * um },

  sample = { driver = "simulated", placement_scatter = 0.3 * mm },

  truth = {
    coil_bandwidth = 50 * Hz,
    coil_delay = 0,
    current_noise = 10 * mA,
    coil_gain_sigma = 0.03,
    coil_position_sigma = 1.2 * mm,
    coil_axis_sigma = 1.5 * deg,
    moment_sigma = 0.05,
    dac_offset_sigma = 2,
  },
}
