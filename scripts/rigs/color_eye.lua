-- The eye with a color camera (thesis 8.3): Bayer filters before the noise, 656 x 490 px of 20.7 um. A pose sensor replaces
-- the operator in steering the robot. The robot is drawn as the ellipsoid that its outline is compared with.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local um, ms, Hz = units.um, units.ms, units.Hz

return {
  base = "spiral_coni",
  title = "Simulated OctoMag with a color camera",

  top_camera = { sensor = { color = "bayer" } },
  pose_sensor = { driver = "simulated", frame_rate = 60 * Hz, latency = 20 * ms, noise = 4 * um },
  sample = { placement_scatter = 0 },

  model = { shape = "ellipsoid" },
  truth = { drawn_as = "ellipsoid" },

  side_camera = false,
}
