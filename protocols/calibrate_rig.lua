-- Calibrates the rig overnight, unattended: cameras, then latency, then coils, each with its acceptance limits. What is accepted
-- goes into calibration.json of the run and into the rig's calibration file, for the next start (docs/how-to/calibrate.md); one
-- that is refused leaves the others.
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "acceptance"
local calibrations = require "calibrations"
local files = require "files"
local units = require "units"
local mm, ms, A, deg = units.mm, units.ms, units.A, units.deg

local function cameras(rig, run, p, book)
  local model = rig:model()
  for role, pixel in pairs { top_camera = model.pixel, side_camera = model.side_pixel } do
    if rig[role] then
      local fit = calibrations.camera(rig, run, role, { count = p.count, half = 3 * mm })
      book:check {
        name = role .. ": pixel",
        part = role,
        key = role .. ".effective_pixel",
        believed = pixel,
        value = fit.pixel,
        sigma = fit.pixel_sigma,
        unit = "m",
        least = 0.98 * pixel,
        most = 1.02 * pixel,
      }
      book:check {
        name = role .. ": rotation",
        part = role,
        believed = 0,
        value = fit.rotation,
        unit = "rad",
        least = -1 * deg,
        most = 1 * deg,
      }
      book:check {
        name = role .. ": what the fit leaves, px rms",
        part = role,
        value = fit.rms_residual_px,
        least = 0,
        most = 0.5,
      }
    end
  end
end

local function latency(rig, run, _, book)
  local believed = rig:model().command_delay
  local delay, constant = calibrations.coil_latency(rig, run, { coil = 1, current = 3 * A })
  book:check {
    name = "coils: delay",
    part = "latency",
    key = "model.coil_delay",
    believed = believed,
    value = delay,
    unit = "s",
    least = believed - 20 * ms,
    most = believed + 20 * ms,
  }
  book:check {
    name = "coils: bandwidth",
    part = "latency",
    key = "model.coil_bandwidth",
    value = 1 / (2 * math.pi * constant),
    unit = "Hz",
    least = 1,
    most = 1000,
  }
  local age = calibrations.camera_latency(rig.top_camera, 10)
  book:check { name = "top_camera: age of its frames", value = age, unit = "s", least = 0, most = 0.4 }
end

local function coils(rig, run, _, book)
  local model, told = calibrations.field(rig, run, {})
  local well = book:check { name = "coils: residual, relative", value = told.residual_relative, least = 0, most = 0.01 }
  if well then
    files.write(
      "octomag_calibrated.yaml",
      model:text { name = "OctoMag", low = { -8 * mm, -8 * mm, -8 * mm }, high = { 8 * mm, 8 * mm, 8 * mm } }
    )
    book:keep("model.calibration", "octomag_calibrated.yaml")
  end
end

return {
  title = "Calibration of the whole rig",
  needs = { "top_camera", "coils", "stage", "field_probe" },
  rig = "calibration",
  parameters = {
    count = { default = 3, min = 2, max = 31, integer = true, help = "places of the target along each side of the grid" },
  },
  run = function(rig, p, run)
    local book = acceptance.new(run, "The rig")
    for part in run:each({ { "cameras", cameras }, { "latency", latency }, { "coils", coils } }, "part") do
      run:checkpoint("before the " .. part[1])
      local done, problem = pcall(part[2], rig, run, p, book)
      if not done then
        run:note(("%s: %s"):format(part[1], tostring(problem)))
        book:check { name = part[1] .. ": could be calibrated", value = 0, least = 1, most = 1 }
      end
    end
    if not book:close() then error("not all numbers were accepted", 0) end
  end,
}
