-- scripts/rigs/simulated.lua with the robot drawn as the ellipsoid that the localizer assumes: for a robot along z, whose two
-- plates are a cross of thin lines from above, which the tracker does not find.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag, the robot drawn as an ellipsoid",
  model = { shape = "ellipsoid" },
  truth = { drawn_as = "ellipsoid" },
}
