-- The simulated laboratory with an eye that is known no better than thesis table 5.1: a loop states its places so.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag, the eye known by table 5.1",
  keep_out = { eye = "table_5_1" },
}
