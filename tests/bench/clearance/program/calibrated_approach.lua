-- Protocol of calibrated_approaches.py: a look at the robot on the retina, as protocols take it, then let down onto it elsewhere.
-- SPDX-License-Identifier: Apache-2.0
local bring = require "session.preparation"
local retina = require "calibration.retina"
local units = require "units"
local mm, s = units.mm, units.s

-- The view that the look gives, by a loop of its own.
local function look(rig, run, background, correction)
  local servo <close> = rig:servo { background = background, lost_timeout = 5 * s, law = "estimator" }
  bring.insert(rig, servo, vector(0, 0, 0))
  bring.trim(servo, vector(0, 0, 0), { rounds = 1, within = 1 * mm })
  local told = retina.calibrate(rig, run, servo, { axis = { 1, 0, 0 }, correction = correction == "eye" and "eye" or nil })
  rig.sample:remove_robot()
  return told.localizer
end

return {
  title = "Let down onto the retina after a look at it",
  needs = { "coils", "sample" },
  parameters = {
    eye = { default = 0, min = 0, max = 1000000, integer = true, help = "of table 5.1, by its number; 0: as believed" },
    correction = { choices = { "eye", "scale" }, default = "eye", help = "what the look puts right" },
    x = { unit = "mm", default = 0 * mm, min = -2 * mm, max = 2 * mm, help = "where it is let down" },
    y = { unit = "mm", default = 0 * mm, min = -2 * mm, max = 2 * mm, help = "the same" },
  },
  run = function(rig, p, run)
    if p.eye > 0 then rig.simulation:set_eye(rig:eye():sample { number = p.eye }) end
    rig.sample:remove_robot()
    local background = rig:learn_background { frames = 15 }
    local view = look(rig, run, background, p.correction)
    run:wait(0.3 * s)
    local servo <close> = rig:servo { background = background, view = view, law = "estimator" }
    local begin = rig:model().eye_in_world + vector(p.x, p.y, 2.6 * mm)
    run:result("retina_radius", rig:model().retina_radius, "m")
    run:result("retina_vertex", rig:model().eye_in_world.z, "m")
    servo:hold(begin)
    rig.sample:insert_robot(begin)
    servo:wait_until_tracked { timeout = 10 * s }
    run:wait(2 * s)
    run:checkpoint "let down"
    servo:set_trim(servo:status().trim + servo:force_for { 0, 0, -0.6 * mm / s })
    servo:release { touch = true }
    run:wait(6 * s)
  end,
}
