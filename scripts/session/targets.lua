-- The target that is localized by focus, set by the operator on a laboratory rig. Positions in the eye's frame, m.
-- SPDX-License-Identifier: Apache-2.0
local targets = {}

--- Puts the target's middle at a place of the eye's frame.
function targets.put(rig, place) rig.sample:place_target(rig:model().eye_in_world + place) end

--- Takes it out of sight.
function targets.remove(rig) rig.sample:remove_target() end

return targets
