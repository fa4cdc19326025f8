-- Replacement of the simulated plant by a measured machine, before anything moves.
-- SPDX-License-Identifier: Apache-2.0
local plant = {}

--- A measured calibration (YAML, as ETH's software writes it) in place of the machine that the seed draws; "": nothing is
--- done. Notes how far the measured machine is from what the loop believes.
function plant.calibrate(rig, run, file)
  if file == "" then return end
  if not rig.simulation then
    error("calibration: this rig is not simulated, so there is no plant to put " .. file .. " into", 0)
  end
  local found = rig.simulation:use_calibration(file)
  local name = found.name ~= "" and (" (%s)"):format(found.name) or ""
  run:note(
    ("the plant is the measured machine of %s%s: its coils differ from the loop's model by %.1f %% at the center"):format(
      file,
      name,
      100 * found.difference
    )
  )
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
