-- The simulated laboratory with a swimmer that has a flexible tail: a magnet in a bead that hardly sinks, and a filament behind
-- it that a field beats which swings to both sides (docs/rotating_fields.md). Default plant: all drawn.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag with a swimmer with a flexible tail",

  model = { robot = "tail_3mm" },
  truth = { machine = "sampled" },
}
