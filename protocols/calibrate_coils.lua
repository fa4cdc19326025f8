-- Calibrates the coils: a field probe on a stage of three axes reads the field of each coil at nine places, and one dipole a coil
-- is fitted; the model goes into octomag_calibrated.yaml, as ETH's software writes it. Unattended, with acceptance limits.
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "calibration.acceptance"
local calibrations = require "calibration.measurements"
local control = require "control"
local files = require "files"
local limits = require "calibration.limits"
local units = require "units"
local mm, A = units.mm, units.A

return {
  title = "Calibration of the coils",
  needs = { "coils", "stage", "field_probe" },
  rig = "calibration",
  parameters = {
    half = { unit = "mm", default = 8 * mm, min = 1 * mm, max = 20 * mm, help = "half the cube's side" },
    current = { unit = "A", default = 8 * A, min = 0.5 * A, max = 12 * A, help = "of each coil, either sign" },
    limit = { default = limits.field, min = 1e-4, max = 0.5, help = "that the fit may leave, relative to the field" },
  },
  run = function(rig, p, run)
    local told = calibrations.field(rig, run, { half = p.half, current = p.current })
    local nominal, before, fields = control.field_model { name = "octomag" }, {}, {}
    for i, reading in ipairs(told.readings) do
      before[i] = (nominal:field({ position = reading.position, currents = reading.currents }).field - reading.field):norm()
      fields[i] = reading.field:norm()
    end
    run:plot {
      title = "Readings against the model as it was",
      x = { "field", "mT" },
      y = { "difference", "mT" },
      series = { { label = "readings", x = fields, y = before, mark = "points" } },
    }
    files.write(
      "octomag_calibrated.yaml",
      told.model:to_yaml { name = "OctoMag", low = { -p.half, -p.half, -p.half }, high = { p.half, p.half, p.half } }
    )
    calibrations.note_coils(run, "at the center against the model as it was", told.coils)
    local book = acceptance.new(run, "Coils")
    limits.coils(book, told, "octomag_calibrated.yaml", { field = p.limit })
    run:result("residual_rms", told.residual_rms, "T")
    run:result("residual_relative", told.residual_relative)
    if not book:close() then error("not all numbers were accepted", 0) end
  end,
}
