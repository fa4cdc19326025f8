-- Drift of a robot that is left alone (thesis 6.1): trimmed by hand at the center, brought near a place, let go, and watched.
-- SPDX-License-Identifier: Apache-2.0
local drift = require "analysis.drift"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, s = units.mm, units.s

local free = {}
local center = vector(0, 0, 0)

--- At which an operator moves the robot.
free.hand_speed = 1.5 * mm / s

--- The thesis' hand trim at the center. What the loop has to add all the time is what the model lacks; an operator leaves a
--- drift of about the tolerance, in any direction.
function free.trim(servo, tolerance, speed)
  for _ = 1, 2 do
    servo:go_to(center, { speed = speed or free.hand_speed, within = 1 * mm, settle = 1 * s })
    servo:set_trim(servo:status().trim + servo:mean_correction(1 * s))
  end
  local left = drift.any_direction() * (tolerance * math.abs(statistics.normal()))
  servo:set_trim(servo:status().trim + servo:force_for(left))
  return servo:status().trim
end

-- Whether the loop goes there: false where the robot would come too near to a wall, by what is known of its depth now, or where
-- the camera does not show it whole.
local function within_reach(servo, place, options)
  local way = { servo:position(), place }
  local problem = servo:refusal(way, { speed = options.speed, acceleration = options.acceleration })
  if not problem then servo:follow(way, options) end
  return not problem, problem
end

--- An operator brings it near the place, to `scatter` along each axis, not to it, and not where a wall is too near;
--- `allowed(position)` says where it may be, `speed` how fast it goes (hand_speed).
function free.bring(run, rig, servo, place, options)
  if not servo:status().position then -- it drifted out of sight: put it in anew
    servo:hold(center)
    rig.sample:insert_robot(center)
    servo:wait_until_tracked()
  end
  local way = { speed = options.speed or free.hand_speed, acceleration = 10 * mm / s ^ 2, label = place.name }
  local near, there, problem
  for _ = 1, 20 do
    repeat
      near = place.position + vector(statistics.normal(), statistics.normal(), statistics.normal()) * options.scatter
    until not options.allowed or options.allowed(near)
    there, problem = within_reach(servo, near, way)
    if there then break end
  end
  if not there then error(problem, 0) end
  run:wait(0.7 * s)
end

--- Velocity of a robot that is left alone, as `let_go` has it, over `time`: m/s.
function free.watch(run, let_go, time)
  let_go()
  run:wait(0.25 * s) -- until what held it has gone through coils and latency
  return drift.velocity(run, time)
end

return free
