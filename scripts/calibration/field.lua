-- The coils' field by the robot's own motion: flights through the workspace, and what they say of a model of the field.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, s = units.mm, units.s
local field = {}

local position = { "x", "y", "z" }

--- Through the corners and the middles of a box about the center, so that each coordinate is crossed at several values of
--- the others; `size`: { x, y } halves, and the heights.
function field.tour(size)
  local points = {}
  for _, z in ipairs(size.heights) do
    for _, corner in ipairs { { 0, 0 }, { -1, -1 }, { 1, -1 }, { 1, 1 }, { -1, 1 }, { -1, -1 } } do
      points[#points + 1] = vector(corner[1] * size.x, corner[2] * size.y, z)
    end
  end
  return points
end

-- A set-point is stamped when the amplifiers have it; a model's delay counts from its decision, which the stream `estimate` has.
-- A row before the first decision is left out.
local function by_decision(currents, decided)
  local rows, k = {}, 0
  for name in pairs(currents) do
    rows[name] = {}
  end
  for i, time in ipairs(currents.time) do
    while decided[k + 1] and decided[k + 1] <= time do
      k = k + 1
    end
    if k > 0 and (#rows.time == 0 or decided[k] > rows.time[#rows.time]) then
      for name, values in pairs(currents) do
        rows[name][#rows[name] + 1] = name == "time" and decided[k] or values[i]
      end
    end
  end
  return rows
end

--- What the record has of a span: a motion for rig:identify_field.
function field.motion(run, span)
  return {
    measured = run:samples("servo", position, span),
    currents = by_decision(run:samples("currents", nil, span), run:samples("estimate", { "x" }, span).time),
  }
end

--- Goes along `points` at 1 mm/s with the robot's axis along `axis`; the motion, and its span.
function field.fly(run, servo, axis, points, options)
  servo:go_to(points[1], { direction = axis, within = 0.4 * mm, within_angle = 15 * units.deg, timeout = 60 * s })
  run:wait(options.settle)
  local span = { from = run:now() }
  servo:follow(points, { speed = 1 * mm / s, acceleration = 5 * mm / s ^ 2, label = options.label })
  span.to = run:now()
  return field.motion(run, span), span
end

-- rad between two directions; a soft robot's axis has no sense.
local function angle_between(a, b)
  local dot = a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
  return math.acos(math.min(1, math.abs(dot) / (a:norm() * b:norm())))
end

-- The index of the last of `times` that is not after `time`, from `k` on.
local function before(times, k, time)
  while times[k + 1] and times[k + 1] <= time do
    k = k + 1
  end
  return k
end

--- Angle between the robot's axis and the field that a model has for the currents, rms over a span, rad, of each model of
--- `models`; nil where the record has no axis. By the simulator's truth or, in a laboratory, by the measured axis. `delay`: from
--- a set-point to its field.
function field.directions(run, models, span, delay)
  local axes = run:samples("truth", { "x", "y", "z", "axis_x", "axis_y", "axis_z" }, span)
  if not axes then
    axes = run:samples("attitude", { "x", "y", "z" }, span)
    local places = run:samples("servo", position, span)
    if not axes or not places then return nil end
    axes = { time = axes.time, axis_x = axes.x, axis_y = axes.y, axis_z = axes.z, places = places }
  end
  local currents = run:samples("currents", nil, span)
  local squares, count, given, seen = {}, 0, 0, 1
  for i = 1, #axes.time, 10 do
    given = before(currents.time, given, axes.time[i] - delay)
    local from = axes.places or axes
    seen = axes.places and before(from.time, seen, axes.time[i]) or i
    local axis = vector(axes.axis_x[i], axes.axis_y[i], axes.axis_z[i])
    local place = vector(from.x[seen], from.y[seen], from.z[seen])
    if given > 0 and axis:norm() > 0 and place:norm() >= 0 then
      local set = {}
      for coil = 1, 8 do
        if currents["i" .. coil] then set[coil] = currents["i" .. coil][given] end
      end
      for name, model in pairs(models) do
        local off = angle_between(vector(model:field({ position = place, currents = set }).field), axis)
        squares[name] = (squares[name] or 0) + off ^ 2
      end
      count = count + 1
    end
  end
  if count == 0 then return nil end
  local found = {}
  for name, sum in pairs(squares) do
    found[name] = math.sqrt(sum / count)
  end
  return found
end

return field
