-- The simulated laboratory on a bench that is not the believed one: eye, condensing lens, microscope and retina are drawn from
-- the run's seed (docs/simulated_laboratory.md), and the localizer knows the eye no better than thesis table 5.1.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag on a bench set up by hand",
  top_camera = { projection = "exact" },
  keep_out = { eye = "table_5_1" },
  truth = { machine = "sampled", optics = { bench = "sampled" } },
}
