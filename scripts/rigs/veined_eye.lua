-- The eye with a color camera under weak light, before a retina about as dark as the robot and full of dark red vessels: what
-- table 8.2 of the thesis shows of its scene (R-G and Y-V good, Y-U worse, H-S and G-B bad). Its light and reflectances are
-- inferred from that table; tables 8.3 and figure 8.7 are then to come out of themselves (docs/vision.md).
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm = units.mm

return {
  base = "color_eye",
  title = "Simulated OctoMag with a color camera in weak light, dark red vessels",

  top_camera = { sensor = { color = "bayer", full_well = 400, read_noise = 16, brightness = 80 } },
  truth = { drawn_as = "ellipsoid", fundus = "veined_fundus.jpg", fundus_width = 30 * mm },
}
