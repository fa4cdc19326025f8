-- Preparation of a servoed experiment: the robot inserted, tracked, trimmed, and put to rest on the retina.
-- SPDX-License-Identifier: Apache-2.0
local statistics = require "analysis.statistics"
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

-- Growth of the robot's image since `from`, 1/s of its radius: a robot that sinks gets smaller. Nothing where it was hardly seen.
local function growth(run, from)
  local seen, times, sizes = run:samples("servo", { "semi_major_px", "semi_minor_px" }, { from = from, to = run:now() }), {}, {}
  for i, time in ipairs(seen.time) do
    local area = seen.semi_major_px[i] * seen.semi_minor_px[i]
    if area > 0 then -- which what is no number is not
      times[#times + 1], sizes[#sizes + 1] = time, math.log(area) / 2
    end
  end
  return #times >= 5 and statistics.line(times, sizes).slope or nil
end

-- A robot that sinks by 20 um/s shrinks by a thousandth a second (5 % a mm, thesis 5.4), twice what the tracker's noise makes of
-- two seconds. It comes to rest within a second of that: a wall slows it down the more, the nearer it is.
local kRest, kLook = 1e-3, 2 * s

--- Lets the robot sink until it lies on the retina below `above`: until its image no longer shrinks, however far below the
--- believed place that is, and however thick the liquid. The force is taken back afterwards by bring.lift. An error where it does
--- not come to rest within `timeout` (60 s). Returns the trim of before, and since when it has been looked at at rest.
function bring.sink(run, servo, above, options)
  options = options or {}
  servo:go_to(above, { within = 1 * mm, settle = 0, speed = 1 * mm / s })
  local trim = servo:status().trim
  servo:set_trim(trim + servo:force_for { 0, 0, -(options.speed or 0.6 * mm / s) })
  servo:release { touch = true }
  local released, rests, from = run:now(), 0, nil
  while rests < 2 do -- two looks in a row: what has just been let go has not begun to sink
    local sinks = run:now() - released
    if sinks > (options.timeout or 60 * s) then error("the robot does not come to rest on the retina", 0) end
    local look = kLook * (1 + sinks // (20 * s)) -- a noisy tracker wants longer ones
    from = run:now()
    run:wait(look)
    local rate = growth(run, from)
    rests = (rate == nil or math.abs(rate) > kRest) and 0 or rests + 1
  end
  return trim, from
end

--- Takes back what pressed the robot down (bring.sink), and holds a place again.
function bring.lift(servo, trim, place)
  servo:set_trim(trim)
  servo:go_to(place, { within = 1 * mm, settle = 0, speed = 1 * mm / s, timeout = 60 * s })
end

return bring
