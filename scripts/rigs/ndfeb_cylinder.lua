-- The laboratory of thesis 6.2's supervised servoing: an NdFeB cylinder of 1 mm by 0.5 mm in the model eye.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag, NdFeB cylinder of 1 mm",
  model = { robot = "ndfeb_cylinder_1mm" },
}
