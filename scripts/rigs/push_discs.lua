-- A robot and three discs of its color on the floor of the eye, seen from above without optics by a color camera (thesis 8.3.1);
-- the pose sensor replaces the operator in steering.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um = units.mm, units.um

-- A disc of the robot's own gray.
local function disc(x, y)
  return {
    shape = "disc",
    semi_axis = 0.3 * mm,
    semi_radius = 0.5 * mm,
    position = { x, y, -4.65 * mm },
    axis = { 0, 0, 1 },
    density = 1200,
    color = { 0.16, 0.16, 0.16 },
  }
end

return {
  base = "color_eye",
  title = "Simulated OctoMag, color camera from above, three discs",

  top_camera = {
    view = "plain",
    width_px = 400,
    height_px = 300,
    effective_pixel = 24 * um,
    projection = false, -- without an eye there is none
    projection_reach = false,
    microscope = { focus = false },
    sensor = { brightness = 200, vignette = 0 },
  },

  truth = {
    bodies = {
      disc = disc(0.4 * mm, 0),
      passed_disc = disc(0.2 * mm, 1.02 * mm),
      far_disc = disc(1.2 * mm, -1.7 * mm),
    },
  },
}
