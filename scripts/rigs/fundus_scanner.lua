-- The miniature ophthalmoscope of thesis appendix A: a small sensor in the aerial image, decentered, on a stage along the axis
-- and on one that turns it about the axis.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "bare_sensor",
  title = "Simulated ophthalmoscope with a turning sensor",

  top_camera = {
    width_px = 330,
    height_px = 360,
    center_px = { 30, 180 }, -- the axis is at the sensor's rim
    sensor_aperture = 0.08, -- of the lens before this sensor; the eye's own pupil would give 0.14 on the axis
  },

  truth = { bodies = { target = false } },
}
