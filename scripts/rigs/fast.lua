-- A rig for the limits of control alone: the simulated laboratory with a pose sensor of 200 readings a second, amplifiers of
-- 50 Hz without transport delay, and no camera (protocols/hold with feedback = "pose_sensor").
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local um, ms, Hz = units.um, units.ms, units.Hz

return {
  base = "simulated",
  title = "Simulated OctoMag with a fast pose sensor",

  model = { coil_delay = 0, coil_bandwidth = 50 * Hz },
  coils = { transfer_interval = 0 }, -- no USB's: eleven frames of 1 ms an update would hold 90 Hz
  pose_sensor = { frame_rate = 200 * Hz, latency = 8 * ms, noise = 0.1 * 5 * um },
  truth = { coil_bandwidth = 50 * Hz, coil_delay = 0 },

  top_camera = false,
  side_camera = false,
  lens_mover = false,
  stage = false,
}
