-- The simulated laboratory with all drawn that a laboratory does not know of its plant: for protocols/dock.lua, whose angles are
-- those of the true robot.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag, its whole plant drawn",
  truth = { machine = "sampled" },
}
