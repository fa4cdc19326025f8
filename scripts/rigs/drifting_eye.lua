-- The eye with a color camera before a retina that moves to and fro as that of an eye under a hand: what background subtraction
-- cannot be used for (thesis 8), and feedback by color is. truth.fundus puts a photograph in the drawn retina's place.
-- SPDX-License-Identifier: Apache-2.0
local mm, s = require("units").mm, require("units").s

return {
  base = "color_eye",
  title = "Simulated OctoMag with a color camera before a moving retina",

  truth = { fundus_drift = 1 * mm / s },
}
