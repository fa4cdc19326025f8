-- Measurements of the rig's calibrations, one function each, shared by the single protocols and calibrate_rig: pixel sizes by
-- a target, latency by a step.
-- SPDX-License-Identifier: Apache-2.0
local control = require "control"
local optics = require "optics"
local statistics = require "analysis.statistics"
local targets = require "session.targets"
local units = require "units"
local vision = require "vision"
local mm, s, ms, A = units.mm, units.s, units.ms, units.A
local calibrations = {}

-- Where a camera shows the target: it is put to each of some places of the world, and `read(place, seen)` has each at which it
-- was seen. Returns how many these are.
local function look_at_target(rig, camera, places, threshold, read)
  local world, found = rig:model().eye_in_world, 0
  targets.remove(rig)
  local tracker = vision.background_tracker { threshold = threshold or 20, min_area_px = 30 }
  for k = 1, 4 do
    tracker:learn(camera:grab({ fresh = k == 1 }).image)
  end
  for _, place in ipairs(places) do
    targets.put(rig, place - world)
    local seen = tracker:update(camera:grab({ fresh = true }).image)
    if seen then
      found = found + 1
      read(place, seen)
    end
  end
  targets.remove(rig)
  return found
end

-- Places of the target in the world, on a grid in the plane that a camera sees.
local function grid(side, count, half)
  local places = {}
  for _, a in ipairs(statistics.range(-half, half, count)) do
    for _, b in ipairs(statistics.range(-half, half, count)) do
      places[#places + 1] = side and vector(a, 0, b) or vector(a, b, 0)
    end
  end
  return places
end

--- Pixel size, rotation and center of one camera ("top_camera", "side_camera") from a target on a grid of places. `half`: half
--- its width, m. Returns what optics.fit_camera says, `places`, how many it was seen at, and `distortion`, the largest part
--- of the residual that grows with the cube of the distance from the center, relative at the grid's corner.
function calibrations.camera(rig, role, options)
  local points, places = {}, grid(role == "side_camera", options.count, options.half)
  look_at_target(rig, rig[role], places, options.threshold, function(place, seen)
    -- the aerial image is inverted: +x of the world is -x of m
    local up = role == "side_camera" and place.z or place.y
    points[#points + 1] = { m = { -place.x, -up }, pixel = { seen.x_px, seen.y_px } }
  end)
  if #points < 4 then error(role .. ": the target was seen at " .. #points .. " places; wants four or more", 0) end
  local fit = optics.fit_camera { points = points }
  local cubic, power = 0, 0
  for _, point in ipairs(points) do
    local u, v = point.pixel[1] - fit.center[1], point.pixel[2] - fit.center[2]
    local x, y = -point.m[1] / fit.pixel, point.m[2] / fit.pixel
    local r2 = x * x + y * y
    cubic = cubic + r2 * (x * (u - x) + y * (v - y))
    power = power + r2 * r2 * r2
  end
  local corner = 2 * (options.half / fit.pixel) ^ 2
  fit.distortion, fit.places = cubic / power * corner, #points
  return fit
end

--- The microscope without an eye below it: pupil, tilt, scale and center from a target on a grid of places in several heights
--- above and below the plane in focus. `half`: half the grid's width, `reach`: the largest height, m; `layers`: how many heights.
--- Returns what optics.fit_microscope says, and `places`, how many it was seen at.
function calibrations.microscope(rig, options)
  local points, places = {}, {}
  for _, z in ipairs(statistics.range(-options.reach, options.reach, options.layers)) do
    for _, place in ipairs(grid(false, options.count, options.half)) do
      places[#places + 1] = place + vector(0, 0, z)
    end
  end
  local found = look_at_target(
    rig,
    rig.top_camera,
    places,
    options.threshold,
    function(place, seen) points[#points + 1] = { position = place, pixel = { seen.x_px, seen.y_px } } end
  )
  if found < 8 then error("the target was seen at " .. found .. " places; wants eight or more", 0) end
  local fit = optics.fit_microscope { points = points }
  fit.places = found
  return fit
end

-- Holds one coil's current for `time`, setting it again and again, or the dead-man takes it for abandoned.
local function hold_current(rig, run, coil, current, time)
  local currents, began = {}, run:now()
  for k = 1, #rig.coils:currents() do
    currents[k] = k == coil and current or 0
  end
  repeat
    rig.coils:set_currents(currents)
    run:wait(math.max(0, math.min(0.04 * s, began + time - run:now())))
  until run:now() >= began + time - 1e-9
end

-- Zero, which needs no renewal: a set-point just before the step would be a step within a millisecond to the interlock.
local function rest(rig, run, time)
  local currents = {}
  for k = 1, #rig.coils:currents() do
    currents[k] = 0
  end
  rig.coils:set_currents(currents)
  run:wait(time)
end

--- How long after a new set-point the coil's field begins to follow, and with which time constant: steps of current seen by the
--- field probe, a robust straight line through the times over log(1 - B/B_end). A teslameter is slower than the coils: the step
--- is repeated, each time asked a little later, over as long as a set-point and a reading take. A reading counts at the moment
--- that the probe says. Returns {delay, constant (s), times, values}.
function calibrations.coil_latency(rig, run, options)
  local coil, current, repeats = options.coil or 1, options.current or 2 * A, options.repeats
  local function field()
    local reading = rig.field_probe:measure()
    return vector(reading), reading.time
  end
  local took = {}
  for k = 1, 3 do
    local asked = run:now()
    rest(rig, run, 1 * ms)
    field()
    took[k] = run:now() - asked
  end
  local spread = math.max(20 * ms, statistics.median(took))
  repeats = repeats or math.max(8, math.ceil(spread / (2.5 * ms))) -- three and more on the slope of a step
  local times, values, zero, final = {}, {}, nil, nil
  for k = 1, repeats do
    rest(rig, run, 0.5 * s)
    zero = zero or (field())
    local began = run:now()
    hold_current(rig, run, coil, current, 1 * ms)
    run:wait(spread * (k - 1) / repeats) -- beyond the set-point's own time on its link, which is 11 ms by USB
    repeat
      local value, at = field()
      times[#times + 1], values[#values + 1] = at - began, (value - zero):norm()
      hold_current(rig, run, coil, current, 1 * ms)
    until run:now() - began > 0.15 * s
    if not final then
      hold_current(rig, run, coil, current, 0.4 * s)
      final = ((field()) - zero):norm()
    end
  end
  rest(rig, run, 1 * ms)
  -- The error is the time's (a set-point that was late on its bus, by whole frames), so t = delay + constant * -log(1 - part).
  local logs, at = {}, {}
  for i = 1, #times do
    local part = values[i] / final
    if part > 0.1 and part < 0.9 then
      logs[#logs + 1], at[#at + 1] = -math.log(1 - part), times[i]
    end
  end
  if #logs < 3 then error("the step is too fast for the probe, or was not seen", 0) end
  local line = statistics.robust_line(logs, at, 0.3)
  return { delay = line.intercept, constant = line.slope, times = times, values = values }
end

--- The coils' field from a probe on a stage of three axes: at the corners of a cube and its middle, one coil at a time with
--- either sign; dipoles fitted. Returns what the fit says, with the model, and the `readings`.
function calibrations.field(rig, run, options)
  local readings, half, count = {}, options.half or 8 * mm, #rig.coils:currents()
  local places = { vector(0, 0, 0) }
  for _, x in ipairs { -half, half } do
    for _, y in ipairs { -half, half } do
      for _, z in ipairs { -half, half } do
        places[#places + 1] = vector(x, y, z)
      end
    end
  end
  for number, place in ipairs(places) do
    run:progress((number - 1) / #places, ("place %d of %d"):format(number, #places))
    run:checkpoint("before place " .. number)
    rig.stage:move_to({ place.x, place.y, place.z })
    for coil = 1, count do
      local currents = {}
      for k = 1, count do
        currents[k] = k == coil and (number % 2 == 0 and 1 or -1) * (options.current or 8 * A) or 0
      end
      for _ = 1, 8 do -- until it stands; and over the way to the next place, which the dead-man would take for abandoned
        rig.coils:set_currents(currents, { hold = 120 * s })
        run:wait(0.05 * s)
      end
      local at = rig.stage:position()
      readings[#readings + 1] =
        { position = vector(at[1], at[2], at[3]), currents = currents, field = vector(rig.field_probe:measure()) }
    end
  end
  local zero = {}
  for k = 1, count do
    zero[k] = 0
  end
  rig.coils:set_currents(zero)
  local fit = control.fit_field_model { readings = readings, sources = "dipoles" }
  fit.readings = readings
  return fit
end

--- Notes how each coil compares with another model: `coils` as control.fit_field_model and use_calibration report them.
function calibrations.note_coils(run, against, coils)
  local lines, reversed = {}, {}
  for number, coil in ipairs(coils) do
    lines[number] = ("coil %d: sign %s, gain %.3f, angle %.1f°"):format(
      number,
      coil.sign < 0 and "-" or "+",
      coil.gain or 0 / 0,
      math.deg(coil.angle)
    )
    if coil.sign < 0 then reversed[#reversed + 1] = ("%d"):format(number) end
  end
  if #lines > 0 then run:note(("%s: %s"):format(against, table.concat(lines, "; "))) end
  if #reversed > 0 then run:note("of opposite sign: coils " .. table.concat(reversed, ", ")) end
end

--- How old a camera's frames are when they arrive, from their own time stamps: {mean, deviation}, s.
function calibrations.camera_latency(camera, count)
  local ages = {}
  for k = 1, count do
    local frame = camera:grab()
    ages[k] = frame.received - frame.time
  end
  return { mean = statistics.mean(ages), deviation = statistics.deviation(ages) }
end

return calibrations
