-- The cameras of thesis 5.5, two Basler A602f: an effective pixel of 20.7 um above, 20.4 um at the side (the printed 2.07 and
-- 2.04 are impossible: the field would be 1.4 mm). The CoNi robot is drawn as the ellipsoid that the localizer assumes: along
-- the axis its two plates are a cross of thin lines, which the tracker does not find.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "spiral_coni",
  title = "Simulated OctoMag of thesis 5.5 with a CoNi robot along z",
  model = { shape = "ellipsoid" },
  truth = { drawn_as = "ellipsoid" },
}
