-- Manual control of a target's depth: the SpaceMouse as a jog, for protocols that are steered by hand.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, s = units.mm, units.s

local by_hand = {}

--- The place, moved up or down as the joystick of the rig is pushed: `speed` (0.5 mm/s) at full deflection, for `dt`. Nothing
--- while it is at rest, or where the rig has no joystick.
function by_hand.jogged(rig, place, dt, speed)
  if not rig.joystick then return nil end
  local push = rig.joystick:state().translation.z
  if push == 0 then return nil end
  return place + vector(0, 0, push * (speed or 0.5 * mm / s) * dt)
end

--- Holds the place, if the servo lets it: what is out of reach leaves the robot where it was. Returns whether it does.
function by_hand.hold(run, servo, place)
  local good, problem = pcall(servo.hold, servo, place)
  if not good then run:note("not there: " .. tostring(problem)) end
  return good
end

return by_hand
