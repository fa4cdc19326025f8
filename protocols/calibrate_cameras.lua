-- Calibrates pixel size, rotation, center and distortion of the cameras from a target that is moved over a grid, "before
-- introducing the eye model" (thesis 5.5). Unattended, with acceptance limits.
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "calibration.acceptance"
local calibrations = require "calibration.measurements"
local limits = require "calibration.limits"
local units = require "units"
local mm = units.mm

return {
  title = "Calibration of the cameras",
  needs = { "top_camera", "sample" },
  rig = "calibration",
  parameters = {
    count = { default = 5, min = 2, max = 31, integer = true, help = "places along each side of the grid" },
    half = { unit = "mm", default = limits.grid, min = 0.5 * mm, max = 10 * mm, help = "half its width" },
    limit = {
      default = limits.pixel,
      min = 0.0001,
      max = 0.5,
      help = "by which a pixel may differ from what is believed at the start, relative",
    },
    residual = { default = limits.residual_px, min = 0.01, max = 10, help = "px that the fit may leave, rms" },
  },
  run = function(rig, p, run)
    local book, model = acceptance.new(run, "Cameras"), rig:model()
    local believed = { top_camera = model.pixel, side_camera = model.side_pixel }
    for _, role in ipairs { "top_camera", "side_camera" } do
      if rig[role] then
        local fit = calibrations.camera(rig, role, { count = p.count, half = p.half })
        run:note(
          ("%s: %d places, residual %.2f px rms, %.2f at most"):format(role, fit.places, fit.rms_residual_px, fit.max_residual_px)
        )
        limits.camera(book, role, fit, believed[role], { pixel = p.limit, residual_px = p.residual })
        run:result(role .. "_pixel", fit.pixel, "m")
      end
    end
    if not book:close() then error("not all numbers were accepted", 0) end
  end,
}
