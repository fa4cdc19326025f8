-- The target that is localized by focus: in the laboratory a stage holds it, and the operator is asked to set it; on a
-- simulated rig it is moved by a call. Positions in the eye's frame, m.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local targets = {}

local away = vector(0, 0, 0.5) -- where it cannot be seen: half a meter off

local function set(rig, position) rig.simulation:move_body("target", position) end

--- Puts the target's middle at a place of the eye's frame.
function targets.put(rig, run, place)
  if rig.simulation then return set(rig, rig:model().eye_in_world + place) end
  run:confirm(
    ("put the target at x %.2f, y %.2f mm, %.2f mm before the retina; is it there?"):format(
      place.x / units.mm,
      place.y / units.mm,
      place.z / units.mm
    )
  )
end

--- Takes the target out of sight.
function targets.remove(rig, run)
  if rig.simulation then return set(rig, away) end
  run:confirm "take the target out of sight; is it out?"
end

return targets
