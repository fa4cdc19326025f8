-- The laboratory of octomag_lab_focus with a small sensor beside the axis, which the turntable takes round (thesis appendix A).
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "octomag_lab_focus",
  title = "OctoMag laboratory, a small sensor that is turned",

  top_camera = {
    width_px = 330,
    height_px = 360,
    center_px = { 30, 180 }, -- the axis is at the sensor's rim
    sensor_aperture = 0.08, -- of the lens before this sensor; the eye's own pupil would give 0.14 on the axis
  },

  truth = { bodies = { target = false } },
}
