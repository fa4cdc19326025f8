-- The laboratory of octomag_lab with a bare sensor in the aerial image, as in thesis chapter 4: the stage moves it along the
-- light, the turntable turns it about the axis, and the operator sets the target with dots before the retina.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, Hz = units.mm, units.um, units.Hz

return {
  base = "octomag_lab",
  title = "OctoMag laboratory, bare sensor behind the condensing lens",

  top_camera = {
    view = "bare_sensor",
    width_px = 1760,
    height_px = 160,
    frame_rate = 15 * Hz,
    effective_pixel = 9.9 * um,
    microscope = { focus = 12 * mm }, -- where the stage's zero is, from the last lens
    sensor_aperture = 0.12, -- within the eye's pupil, 0.14 seen from here, whose rim rays are lost
  },

  truth = { -- what stands for the target in a dry run and under `vitreo emulate`
    bodies = {
      target = {
        shape = "disc",
        semi_axis = 20 * um,
        semi_radius = 0.6 * mm,
        position = { 0, 0, 20 * mm },
        axis = { 0, 0, 1 },
        fixed = true,
        dotted = true,
        dot_pitch = 0.15 * mm,
        color = { 1, 1, 1 },
      },
    },
  },
}
