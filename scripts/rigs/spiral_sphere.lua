-- The cameras of thesis 5.5, two Basler A602f: an effective pixel of 20.7 um above, 20.4 um at the side (the printed 2.07 and
-- 2.04 are impossible: the field would be 1.4 mm). Otherwise as scripts/rigs/simulated.lua, with a sphere of 0.5 mm.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "spiral_coni",
  title = "Simulated OctoMag of thesis 5.5 with an NdFeB sphere",
  model = { robot = "ndfeb_sphere_500um" },
}
