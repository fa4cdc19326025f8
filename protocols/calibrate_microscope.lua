-- Calibrates the microscope alone, without an eye below it: a target goes over a grid in several heights, and its pupil, tilt,
-- scale and center are fitted (docs/chain.md). Accepted numbers are installed; the rest goes into the report as the numbers
-- that calibrate_bench and calibrate_in_eye take.
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "calibration.acceptance"
local calibrations = require "calibration.measurements"
local chain = require "calibration.chain"
local limits = require "calibration.limits"
local units = require "units"
local mm = units.mm

return {
  title = "Calibration of the microscope on a target",
  needs = { "top_camera", "sample" },
  rig = "microscope_target",
  parameters = {
    count = { default = 5, min = 2, max = 21, integer = true, help = "places along each side of the grid" },
    half = { unit = "mm", default = 4 * mm, min = 0.5 * mm, max = 10 * mm, help = "half its width" },
    layers = { default = 5, min = 2, max = 21, integer = true, help = "heights" },
    reach = { unit = "mm", default = 4 * mm, min = 0.5 * mm, max = 10 * mm, help = "the largest, above and below the focus" },
  },
  run = function(rig, p, run)
    local book, model = acceptance.new(run, "Microscope"), rig:model()
    local fit = calibrations.microscope(rig, { count = p.count, half = p.half, layers = p.layers, reach = p.reach })
    run:note(("%d places, residual %.2f px rms, %.2f at most"):format(fit.places, fit.rms_residual_px, fit.max_residual_px))
    limits.microscope(book, fit, model)
    run:result("pixel", fit.pixel, "m")
    run:result("pupil_power", fit.pupil_power, "1/m")
    run:result("pupil_power_sigma", fit.pupil_power_sigma, "1/m")
    run:result("tilt_x", fit.tilt[1], "rad")
    run:result("tilt_y", fit.tilt[2], "rad")
    run:table {
      title = "As numbers of a viewing chain",
      header = { "parameter", "off", "sigma" },
      rows = chain.rows(chain.microscope_numbers(rig, fit)),
    }
    if not book:close() then error("not all numbers were accepted", 0) end
  end,
}
