-- Calibrates pixel size, rotation, centre and distortion of the cameras from a target that is moved over a grid, "before
-- introducing the eye model" (thesis 5.5). Unattended, with acceptance limits.
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "acceptance"
local calibrations = require "calibrations"
local units = require "units"
local mm, deg = units.mm, units.deg

return {
  title = "Calibration of the cameras",
  needs = { "top_camera" },
  rig = "calibration",
  parameters = {
    count = { default = 5, min = 2, max = 31, integer = true, help = "places along each side of the grid" },
    half = { unit = "mm", default = 3 * mm, min = 0.5 * mm, max = 10 * mm, help = "half its width" },
    limit = {
      default = 0.02,
      min = 0.0001,
      max = 0.5,
      help = "by which a pixel may differ from what is believed at the start, relative",
    },
    residual = { default = 0.5, min = 0.01, max = 10, help = "px that the fit may leave, rms" },
  },
  run = function(rig, p, run)
    local book, model = acceptance.new(run, "Cameras"), rig:model()
    local believed = { top_camera = model.pixel, side_camera = model.side_pixel }
    for _, role in ipairs { "top_camera", "side_camera" } do
      if rig[role] then
        local fit, points = calibrations.camera(rig, run, role, { count = p.count, half = p.half })
        run:note(
          ("%s: %d places, residual %.2f px rms, %.2f at most"):format(role, points, fit.rms_residual_px, fit.max_residual_px)
        )
        local pixel = believed[role]
        book:check {
          name = role .. ": pixel",
          part = role,
          key = role .. ".effective_pixel",
          believed = pixel,
          value = fit.pixel,
          sigma = fit.pixel_sigma,
          unit = "m",
          least = (1 - p.limit) * pixel,
          most = (1 + p.limit) * pixel,
        }
        book:check {
          name = role .. ": rotation",
          part = role,
          believed = 0,
          value = fit.rotation,
          sigma = fit.rotation_sigma,
          unit = "rad",
          least = -1 * deg,
          most = 1 * deg,
        }
        book:check {
          name = role .. ": what the fit leaves, px rms",
          part = role,
          value = fit.rms_residual_px,
          least = 0,
          most = p.residual,
        }
        book:check {
          name = role .. ": distortion at the corner",
          part = role,
          believed = 0,
          value = fit.distortion,
          least = -0.01,
          most = 0.01,
        }
        run:figure(role .. "_pixel", fit.pixel, "m")
      end
    end
    if not book:close() then error("not all numbers were accepted", 0) end
  end,
}
