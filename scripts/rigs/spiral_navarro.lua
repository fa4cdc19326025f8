-- The spiral's rig of thesis 5.5 about a human eye: Navarro's in its cavity, known no better than table 5.1 says. A true eye of
-- another build can stand there: localize_spiral eye=toric, eye=liou_brennan.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "spiral_uncertain",
  title = "Simulated OctoMag of thesis 5.5 about Navarro's eye, known by table 5.1",
  model = { eye = "navarro_condensing" },
}
