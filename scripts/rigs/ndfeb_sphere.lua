-- scripts/rigs/simulated.lua with the NdFeB sphere of 0.5 mm of thesis 5.5.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag, NdFeB sphere of 0.5 mm",
  model = { robot = "ndfeb_sphere_500um" },
}
