-- Preparation of a servoed experiment: the robot inserted, tracked, trimmed, and put to rest on the retina.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, s = units.mm, units.um, units.s
local bring = {}

--- Uncertainty of the robot's axis about the commanded one (axis_uncertainty of rig:servo): none, as in the thesis, or the angle
--- by which unmeasured coils turn the field.
function bring.axis_uncertainty(attitude) return attitude == "estimated" and 4 * units.deg or 0 end

--- Puts the robot in near a place and waits until the loop sees it.
function bring.insert(rig, servo, place)
  servo:hold(place)
  rig.sample:insert_robot(place)
  return servo:wait_until_tracked { timeout = 10 * s }
end

--- The thesis' hand trim ("manually adjusted for local stability at the center", 6.1), by measurement: at rest in the center,
--- what the loop has to add all the time is what the model lacks.
function bring.trim(servo, center, options)
  options = options or {}
  for _ = 1, options.rounds or 2 do
    servo:go_to(center, { within = options.within or 400 * um, settle = 2 * s })
    servo:set_trim(servo:status().trim + servo:mean_correction(options.listen or 3 * s))
  end
end

--- Lets the robot sink until it lies on the retina below `above`, and waits `rest`. The force is taken back afterwards by
--- bring.lift.
function bring.sink(run, servo, above, options)
  options = options or {}
  servo:go_to(above, { within = 1 * mm, settle = 0, speed = 1 * mm / s })
  local trim = servo:status().trim
  servo:set_trim(trim + servo:force_for { 0, 0, -(options.speed or 0.6 * mm / s) })
  servo:release { touch = true }
  run:wait(options.time or 8 * s)
  return trim
end

--- Takes back what pressed the robot down (bring.sink), and holds a place again.
function bring.lift(servo, trim, place)
  servo:set_trim(trim)
  servo:go_to(place, { within = 1 * mm, settle = 0, speed = 1 * mm / s, timeout = 60 * s })
end

return bring
