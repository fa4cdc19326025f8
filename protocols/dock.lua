-- Docking at several angles: the robot turns into a direction at a stand-off, and goes along it to a place, as into a port. How
-- far its axis and its position are from what was wanted, by the simulator's truth or, in a laboratory, by the loop's own
-- measurement. For the rig scripts/rigs/dock.lua.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, um, s, mT, deg = units.mm, units.um, units.s, units.mT, units.deg

local port = vector(1 * mm, 0, 0.5 * mm)
-- Pitch above the horizontal and azimuth about the eye's axis, degrees; the robot's axis is at first along x.
local angles = { { 0, 0 }, { 0, 40 }, { 30, 20 }, { 60, 0 }, { 85, 0 }, { 45, -45 } }

local function direction_of(pitch, azimuth)
  local p, a = pitch * deg, azimuth * deg
  return vector(math.cos(p) * math.cos(a), math.cos(p) * math.sin(a), math.sin(p))
end

-- rad between two directions; a soft robot's axis has no sense.
local function angle_between(a, b)
  local dot = math.abs(a[1] * b[1] + a[2] * b[2] + a[3] * b[3])
  return math.acos(math.min(1, dot))
end

-- Means over a span: the angle off and the distance off; by the stream that knows best.
local function judge(run, span, wanted)
  local truth = run:samples("truth", { "x", "y", "z", "axis_x", "axis_y", "axis_z" }, span)
  local seen = truth and { truth.axis_x, truth.axis_y, truth.axis_z }
  if not seen then
    local own = run:samples("attitude", { "x", "y", "z" }, span)
    seen = { own.x, own.y, own.z }
  end
  local angle, worst, count = 0, 0, 0
  for i, x in ipairs(seen[1]) do
    if x == x then
      local off = angle_between({ x, seen[2][i], seen[3][i] }, wanted)
      angle, worst, count = angle + off, math.max(worst, off), count + 1
    end
  end
  if count == 0 then error("the robot's axis was not measured: it wants law estimator, or a pose sensor", 0) end
  local place = truth or run:samples("servo", { "x", "y", "z" }, span)
  local squares, places = 0, 0
  for i, x in ipairs(place.x) do
    if x == x then
      local off = vector(x, place.y[i], place.z[i]) - port
      squares, places = squares + off:norm() ^ 2, places + 1
    end
  end
  return { angle = angle / count, worst = worst, distance = math.sqrt(squares / math.max(places, 1)) }
end

return {
  title = "Docking at several angles",
  needs = { "coils", "sample" },
  rig = "dock",
  parameters = {
    feedback = { choices = { "pose_sensor", "two_cameras", "one_camera" }, default = "pose_sensor", help = "of the loop" },
    field = { unit = "mT", default = 15 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
    stand_off = { unit = "mm", default = 0.6 * mm, min = 0.1 * mm, max = 3 * mm, help = "from where it goes along its axis" },
    settle = { unit = "s", default = 4 * s, min = 0.5 * s, max = 60 * s, help = "at the stand-off, its axis turned" },
    hold = { unit = "s", default = 2 * s, min = 0.5 * s, max = 60 * s, help = "in the port, measured" },
    angles = { default = #angles, min = 1, max = #angles, integer = true, help = "how many of the angles" },
  },
  run = function(rig, p, run)
    local background
    rig.sample:remove_robot()
    if p.feedback ~= "pose_sensor" then background = rig:learn_background { frames = 15 } end
    local servo <close> = rig:servo {
      law = "estimator",
      feedback = p.feedback,
      background = background,
      field = p.field,
    }
    servo:hold(port)
    rig.sample:insert_robot(port)
    servo:wait_until_tracked()
    local rows, largest, farthest = {}, 0, 0
    for k in run:each(p.angles, "angle") do
      local pitch, azimuth = angles[k][1], angles[k][2]
      local direction = direction_of(pitch, azimuth)
      local before = port - p.stand_off * direction
      servo:go_to(before, { direction = direction, within = 0.3 * mm, within_angle = 10 * deg, timeout = 60 * s })
      run:wait(p.settle)
      servo:go_to(port, { within = 0.15 * mm, speed = 0.3 * mm / s, timeout = 60 * s })
      local span = { from = run:now() }
      run:wait(p.hold)
      span.to = run:now()
      local found = judge(run, span, direction)
      local status = servo:status()
      largest, farthest = math.max(largest, found.angle), math.max(farthest, found.distance)
      run:record("dock", { pitch = pitch * deg, azimuth = azimuth * deg, angle_error = found.angle, error = found.distance })
      rows[k] = {
        ("%.0f"):format(pitch),
        ("%.0f"):format(azimuth),
        ("%.2f"):format(found.angle / deg),
        ("%.2f"):format(found.worst / deg),
        ("%.0f"):format(found.distance / um),
        ("%.1f"):format(status.field / mT),
        status.limited and "yes" or "no",
      }
    end
    run:result("dock_angle_error_max", largest, "rad")
    run:result("dock_position_error_max", farthest, "m")
    run:headline(("In the port within %s and %s"):format(format_quantity(largest, "rad"), format_quantity(farthest, "m")))
    run:table {
      title = "In the port: axis and position against what was wanted; feedback " .. p.feedback,
      header = { "pitch, °", "azimuth, °", "angle off, °", "largest, °", "distance off, µm", "field, mT", "limited" },
      rows = rows,
    }
  end,
}
