-- Targets that are fixed to the retina: beside a servo loop each frame is found on a map of the retina, and a target's place in
-- the world follows the point of the map over which it stands, at its depth. What moves the retina in the image moves the target,
-- and the zones that the robot is to keep out of.
-- SPDX-License-Identifier: Apache-2.0
local retina_zones = require "session.retina_zones"
local statistics = require "analysis.statistics"
local units = require "units"
local vision = require "vision"
local mm, um, s = units.mm, units.um, units.s
local retina_targets = {}

-- Of frames over which a target's velocity is fitted: at 15 to 60 frames/s less than a third of a second.
local most_frames = 5
-- Without a frame on the map for so long, the target's place is not known.
local forgotten = 1 * s
-- Between the robot's outline and a zone: three times what the loop leaves of the way over the retina (docs/vision.md).
local zone_margin = 0.2 * mm

--- A map of the retina as the top camera sees it, for targets of `servo` with the localizer `view` (rig:view()).
function retina_targets.open(rig, run, servo, view)
  return {
    rig = rig,
    run = run,
    servo = servo,
    view = view or rig:view(),
    model = rig:model(),
    map = vision.retina_map {},
    zones = {},
    frames = 0,
    found = 0,
  }
end

-- What is not retina: the robot's outline where the loop sees it.
local function robot_in_view(retina)
  local status = retina.servo:status()
  if not status.position then return nil end
  local place = status.position - retina.model.eye_in_world
  local seen = retina.view:ellipse { body = retina.model.robot, position = place, axis = status.axis or status.direction }
  if not seen then return nil end
  return { x_px = seen.u, y_px = seen.v, major_px = 2 * seen.semi_major, minor_px = 2 * seen.semi_minor, angle = seen.angle }
end

--- Finds the next frame on the map, and records it as the stream `retina`. Returns whether it was found.
function retina_targets.look(retina)
  local frame = retina.rig.top_camera:grab()
  local robot = robot_in_view(retina)
  local pose = retina.map:update(frame.image, { body = robot })
  retina.frames, retina.pose, retina.robot = retina.frames + 1, pose, robot
  local row = { exposed = frame.time, x_px = 0 / 0, y_px = 0 / 0, angle = 0 / 0, scale = 0 / 0, sigma_px = 0 / 0 }
  if pose then
    retina.found, retina.time = retina.found + 1, frame.time
    row.x_px, row.y_px, row.angle, row.scale, row.sigma_px = pose.x_px, pose.y_px, pose.angle, pose.scale, pose.sigma_px
  end
  retina.run:record("retina", row, { exposed = "s", angle = "rad" }, {
    exposed = "the frame's exposure",
    x_px = "of the frame's first pixel, in the map",
    y_px = "of the frame's first pixel, in the map",
    sigma_px = "of a point's place in the map",
  })
  return pose ~= nil
end

-- The world's place at the height `z` that is seen at a pixel: Newton's method on the view's chief rays, by differences.
local function at_pixel(retina, u, v, z, start)
  local origin, step = retina.model.eye_in_world, 20 * um
  local place = vector(start.x, start.y, z)
  for _ = 1, 8 do
    local here = retina.view:pixel(place - origin)
    local right = retina.view:pixel(place - origin + vector(step, 0, 0))
    local back = retina.view:pixel(place - origin + vector(0, step, 0))
    if not (here and right and back) then return nil end
    local a, b = (right.u - here.u) / step, (back.u - here.u) / step
    local c, d = (right.v - here.v) / step, (back.v - here.v) / step
    local du, dv, det = u - here.u, v - here.v, a * d - b * c
    if math.abs(det) < 1e-6 then return nil end
    local move = vector((d * du - b * dv) / det, (a * dv - c * du) / det, 0)
    place = place + move
    if move:norm() < 0.1 * um then return place end
  end
  return nil
end

--- The target of which `position` (m, world) is the present place: fixed to the point of the retina that is seen behind it.
--- After a frame that was found; an error where the position is out of view.
function retina_targets.fix(retina, position)
  local seen = retina.view:pixel(position - retina.model.eye_in_world)
  if not seen then error("a target by retina: its place is not in view", 0) end
  local on_map = retina.map:to_map(seen.u, seen.v)
  return { x_px = on_map.x_px, y_px = on_map.y_px, z = position.z, place = position, passed = {} }
end

--- Position (m, world) and velocity of a target when the last frame was exposed, which was found; nothing where its place is
--- out of view. For each frame in turn: the velocity is that of the last few.
function retina_targets.place(retina, target)
  local at = retina.map:to_image(target.x_px, target.y_px)
  local place = at_pixel(retina, at.x_px, at.y_px, target.z, target.place)
  if not place then return nil end
  target.place = place
  local passed = target.passed
  if #passed > 0 and retina.time - passed[#passed].time > 0.3 * s then
    passed = {}
    target.passed = passed
  end
  passed[#passed + 1] = { time = retina.time, place = place }
  if #passed > most_frames then table.remove(passed, 1) end
  local mean_time = statistics.mean(statistics.map(passed, function(one) return one.time end))
  local velocity, spread = vector(0, 0, 0), 0
  for _, one in ipairs(passed) do
    velocity = velocity + one.place * (one.time - mean_time)
    spread = spread + (one.time - mean_time) ^ 2
  end
  return place, #passed > 2 and velocity * (1 / spread) or vector(0, 0, 0)
end

--- A zone in which the robot's outline is not to be seen: the part of the retina that is seen now within `radius` (m) of
--- `position` (m, world). After a frame that was found. Returns its number.
function retina_targets.forbid(retina, position, radius)
  local center = retina_targets.fix(retina, position)
  local edge = retina_targets.fix(retina, position + vector(radius, 0, 0))
  local far = math.sqrt((edge.x_px - center.x_px) ^ 2 + (edge.y_px - center.y_px) ^ 2)
  retina.zones[#retina.zones + 1] = { x_px = center.x_px, y_px = center.y_px, radius_px = far, least = math.huge }
  return #retina.zones
end

-- Where the zones are at the height z: `at` (m, in the plane), `clear` (m, from it, for the robot's center), and their radius.
-- After a frame that was found; one row each of the stream `no_go_zones`, which the live view draws.
local function place_zones(retina, z, start)
  local reach_px = retina.robot and retina.robot.major_px / 2 or 0
  for number, zone in ipairs(retina.zones) do
    local seen = retina.map:to_image(zone.x_px, zone.y_px)
    local rim = retina.map:to_image(zone.x_px + zone.radius_px, zone.y_px)
    local radius_px = math.sqrt((rim.x_px - seen.x_px) ^ 2 + (rim.y_px - seen.y_px) ^ 2)
    local at = at_pixel(retina, seen.x_px, seen.y_px, z, zone.place or start)
    local edge = at and at_pixel(retina, seen.x_px + radius_px + reach_px, seen.y_px, z, at)
    if not edge then error(("the no-go zone %d is out of view: where it is, is not known"):format(number), 0) end
    zone.place, zone.at = at, vector(at.x, at.y, 0)
    zone.reach = (edge - at):norm()
    zone.clear = zone.reach + zone_margin
    local row =
      { zone = number, u_px = seen.x_px, v_px = seen.y_px, radius_px = radius_px, x = at.x, y = at.y, clearance = 0 / 0 }
    local status = retina.servo:status()
    if status.position and retina.robot then
      local away = status.position - at
      row.clearance = math.sqrt(away.x ^ 2 + away.y ^ 2) - zone.reach
      zone.least = math.min(zone.least, row.clearance)
    end
    retina.run:record("no_go_zones", row, { x = "m", y = "m", clearance = "m" }, {
      u_px = "of its middle, in the frame",
      v_px = "of its middle, in the frame",
      x = "of its middle, at the target's height",
      y = "of its middle, at the target's height",
      clearance = "of the robot's outline from it, seen from above",
    })
  end
end

-- An alarm while the robot's outline is over a zone; steer() leads it out.
local function watch_zones(retina)
  for number, zone in ipairs(retina.zones) do
    local within = zone.least < 0 and not zone.told
    if within then
      zone.told = true
      local text = ("the robot is over the no-go zone %d, and is led out of it"):format(number)
      retina.run:alarm { name = "no-go zone " .. number, priority = "high", text = text }
    end
  end
end

-- One row of the stream `robot_on_retina`: the robot and where it should be, on the map.
local function record_robot(retina, target)
  if not retina.robot then return end
  local at = retina.map:to_map(retina.robot.x_px, retina.robot.y_px)
  retina.run:record("robot_on_retina", {
    x_px = at.x_px,
    y_px = at.y_px,
    target_x_px = target.x_px,
    target_y_px = target.y_px,
  }, {}, {
    x_px = "of the robot, in the map",
    y_px = "of the robot, in the map",
    target_x_px = "where it should be",
    target_y_px = "where it should be",
  })
end

-- The reference's next place from the target: straight up to it, or around the zones; outside of them it keeps to.
local function come_nearer(retina, place, apart, step)
  local left = apart:norm()
  local straight = left > step and apart * (1 - step / left) or vector(0, 0, 0)
  if #retina.zones == 0 then return straight end
  local over = retina_zones.step(retina.zones, place + apart, place, step) - vector(place.x, place.y, 0)
  return vector(over.x, over.y, straight.z)
end

-- One frame: what the reference is to do, and whether the robot is there. `apart`: of the reference from the target, which it
-- comes up to at `speed`. Returns apart, the robot's distance from the target, and what the loop refused.
local function steer(retina, target, apart, speed)
  local before = retina.time
  local place, velocity
  if retina_targets.look(retina) then
    place, velocity = retina_targets.place(retina, target)
  end
  local status = retina.servo:status()
  if not (place and status.position) then
    local unknown = retina.time and retina.run:now() - retina.time > forgotten
    return apart, nil, (unknown or retina.pose) and "the retina or the robot is not found, or the target is out of view" or nil
  end
  apart = apart or status.position - place
  place_zones(retina, place.z, place)
  watch_zones(retina)
  local step = speed * (before and retina.time - before or 0)
  local nearer = come_nearer(retina, place, apart, step)
  local wanted = velocity
  if step > 0 and nearer:norm() > 0 then wanted = velocity + (nearer - apart) * (speed / step) end
  apart = nearer
  -- The place is that of the frame's exposure; the reference begins now.
  local ahead = retina.run:now() - retina.time
  local went, refused = pcall(retina.servo.hold, retina.servo, place + apart + wanted * ahead, { velocity = wanted })
  record_robot(retina, target)
  local off = status.position - (place + velocity * (status.time - retina.time))
  return apart, off, not went and tostring(refused) or nil
end

--- Takes the robot to a target by retina, and stays over it: `speed` over the retina (0.5 mm/s), `within` (0.3 mm) for
--- `settle` (1 s), at most `timeout` (60 s). Returns {reached =, problem =, off = {m, ...}}: distances in the horizontal plane
--- while it stayed. The reference rests while the retina is not found. It leads around the zones; a target that the robot could
--- not be over without touching one is refused before anything moves.
function retina_targets.go_to(retina, target, options)
  local run, speed, within = retina.run, options.speed or 0.5 * mm / s, options.within or 0.3 * mm
  local deadline = run:now() + (options.timeout or 60 * s)
  local apart, since, off, problem
  place_zones(retina, target.z, target.place)
  local forbidden = retina_zones.inside(retina.zones, target.place)
  if forbidden then return { reached = false, off = {}, problem = ("it lies in the no-go zone %d"):format(forbidden) } end
  while run:now() < deadline do
    local away
    apart, away, problem = steer(retina, target, apart, speed)
    if away and apart:norm() == 0 and away:norm() < within then
      since, off = since or retina.time, off or {}
      off[#off + 1] = math.sqrt(away.x ^ 2 + away.y ^ 2)
      if retina.time - since >= (options.settle or 1 * s) then return { reached = true, off = off } end
    elseif away then
      since, off = nil, nil
    end
  end
  return { reached = false, problem = problem or "not there in time", off = {} }
end

--- Stays over a target for one more frame.
function retina_targets.keep(retina, target) steer(retina, target, vector(0, 0, 0), 0) end

return retina_targets
