-- The spiral's rig of thesis 5.5 for an eye that is known no better than table 5.1 says: the loop's record states the position's
-- uncertainty with the eye, the retina's depth and the calibration in it (docs/chain.md).
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "spiral_coni",
  title = "Simulated OctoMag of thesis 5.5, the eye known by table 5.1",
  keep_out = { eye = "table_5_1" },
}
