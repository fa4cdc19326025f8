-- The simulated laboratory: an OctoMag round the two-lens model eye of thesis table 5.3, a microscope on its aerial image,
-- a camera from the side, and a 2 mm CoNi robot in silicone oil. Everything runs without hardware.
local units = require "units"
local mm, um, ms, s, Hz, A, cSt = units.mm, units.um, units.ms, units.s, units.Hz, units.A, units.cSt
local mA, deg = units.mA, units.deg

return {
  title = "Simulated OctoMag with the model eye of thesis table 5.3",

  model = { -- what the loop believes
    eye = "model_eye_5_3",
    eye_in_world = { 0, 0, -5 * mm }, -- the retina's vertex
    robot = "coni_2mm",
    field = "octomag", -- dipoles; calibration = "FILE.yaml" in its place: what ETH's software measured
    coil_delay = 50 * ms, -- from the loop's set point to the first change of current: link and amplifiers
    coil_bandwidth = 15 * Hz,
    medium = { name = "silicone oil", density = 970, kinematic_viscosity = 500 * cSt },
  },

  top_camera = {
    driver = "simulated",
    width_px = 1384,
    height_px = 1036,
    frame_rate = 15 * Hz,
    latency = 80 * ms, -- with the coils' 50 ms: the 130 ms of the loop
    effective_pixel = 14.3 * um,
    projection = "single_viewpoint", -- the thesis' model; "exact" localizes by the chain's own chief rays
    microscope = { numerical_aperture = 0.01, focus = 12.3 * mm, decenter = { 0, 0 }, tilt = { 0, 0 } }, -- telecentric
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

  lens_mover = { driver = "pololu_tic", address = "emulated", travel = 10 * mm, speed = 5 * mm / s },

  -- The microscope on its focusing stage, at 0 when it is at its focus: Zaber's driver over its emulator.
  stage = { driver = "simulated", address = "emulated", carries = "sensor" },

  -- For judging control without optics: feeds the truth, late and noisy, to a loop that asks for it by name.
  pose_sensor = { driver = "simulated", frame_rate = 15 * Hz, latency = 80 * ms, noise = 0.3 * 14.3 * um },

  -- keep_out = { margin = 0.2 * mm }, -- what the surface of the robot leaves of retina and lens: docs/safety.md

  sample = { driver = "simulated", placement_scatter = 0.3 * mm },

  truth = { -- how far the simulated machine is from the model; the draws come from the run's seed
    coil_bandwidth = 15 * Hz,
    coil_delay = 40 * ms, -- of the amplifiers alone: a set point's ten frames on the USB are the rest of the 50 ms
    current_noise = 10 * mA,
    -- calibration = "FILE.yaml", -- a measured machine in the plant's place, as ETH's software writes it
    coil_gain_sigma = 0.03, -- with a calibration: leave these three away
    coil_position_sigma = 1.2 * mm,
    coil_axis_sigma = 1.5 * deg,
    moment_sigma = 0.05,
    dac_offset_sigma = 2,
  },
}
