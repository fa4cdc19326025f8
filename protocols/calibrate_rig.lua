-- Calibrates the rig overnight, unattended: cameras, then latency, then coils, each with its acceptance limits. Accepted
-- values go into calibration.json of the run and into the rig's calibration file, for the next start
-- (docs/how-to/calibrate.md); a refused one leaves the others in force.
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "calibration.acceptance"
local calibrations = require "calibration.measurements"
local files = require "files"
local limits = require "calibration.limits"
local units = require "units"
local mm, A = units.mm, units.A

local function cameras(rig, run, p, book)
  local model = rig:model()
  for role, pixel in pairs { top_camera = model.pixel, side_camera = model.side_pixel } do
    if rig[role] then
      local fit = calibrations.camera(rig, role, { count = p.count, half = limits.grid })
      limits.camera(book, role, fit, pixel)
    end
  end
end

local function latency(rig, run, _, book)
  local step = calibrations.coil_latency(rig, run, { coil = 1, current = 3 * A })
  limits.coil_latency(book, rig:model(), step)
  limits.frames(book, "top_camera", calibrations.camera_latency(rig.top_camera, 10))
end

local function coils(rig, run, _, book)
  local file, reach = "octomag_calibrated.yaml", 8 * mm
  local told = calibrations.field(rig, run, { half = reach })
  files.write(file, told.model:to_yaml { name = "OctoMag", low = { -reach, -reach, -reach }, high = { reach, reach, reach } })
  limits.coils(book, told, file)
end

return {
  title = "Calibration of the whole rig",
  needs = { "top_camera", "coils", "stage", "field_probe", "sample" },
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
