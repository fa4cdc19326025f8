-- The simulated laboratory with a helical swimmer in the oil: a resin helix about a magnet that is magnetized across its axis
-- (docs/rotating_fields.md). Its field turns; a field gradient could not carry it along the axis. Default plant: all drawn.
-- SPDX-License-Identifier: Apache-2.0
return {
  base = "simulated",
  title = "Simulated OctoMag with a helical swimmer",

  model = { robot = "helix_2mm" },
  truth = { machine = "sampled" },
}
