-- scripts/rigs/color_eye.lua with a needle above the robot (thesis 8.3.2): Bayer filters, 656 x 490 px of 20.7 um. A pose
-- sensor replaces the operator in steering the robot. The robot is drawn as the ellipsoid that its outline is compared with.
-- SPDX-License-Identifier: Apache-2.0
local mm = require("units").mm

return {
  base = "color_eye",
  title = "Simulated OctoMag with a color camera and a needle",

  truth = {
    bodies = {
      needle = {
        shape = "rod",
        semi_axis = 8 * mm,
        semi_radius = 0.2 * mm,
        position = { 0, 0, 4.5 * mm },
        axis = { 0, 1, 0 },
        fixed = true,
        color = { 0.55, 0.55, 0.58 },
      },
    },
  },
}
