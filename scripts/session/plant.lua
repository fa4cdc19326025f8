-- Replacement of the simulated plant by a measured machine, before anything moves.
-- SPDX-License-Identifier: Apache-2.0
local calibrations = require "calibration.measurements"

local plant = {}

--- A measured calibration (YAML, as ETH's software writes it) in place of the machine that the seed draws; "": nothing is
--- done. Notes how each coil of the measured machine compares with what the loop believes.
function plant.calibrate(rig, run, file)
  if file == "" then return end
  if not rig.simulation then
    error("calibration: this rig is not simulated, so there is no plant to put " .. file .. " into", 0)
  end
  local found = rig.simulation:use_calibration(file)
  local name = found.name ~= "" and (" (%s)"):format(found.name) or ""
  run:note(("the plant is the measured machine of %s%s"):format(file, name))
  for _, warning in ipairs(found.warnings) do
    run:note(warning)
  end
  calibrations.note_coils(run, "at the center against the loop's model", found.coils)
  local channels, same = {}, true
  for coil, channel in ipairs(found.channels) do
    channels[coil] = ("%d"):format(channel)
    same = same and coil == channel
  end
  if not same then
    run:note("the file numbers the coils in another order: they are wired to the channels " .. table.concat(channels, ", "))
  end
end

return plant
