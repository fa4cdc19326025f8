-- No-go zones that are fixed to the retina: discs of a retina map over which the robot's body is not to be. A reference that
-- moves over the retina leads around them, and a robot that has come into one is led out again. A zone is where it was seen in
-- the last frame that was found on the map.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local um, mm = units.um, units.mm
local retina_zones = {}

-- Left between body and zone, beside what a script asks for: the reference's polygon on a circle.
local slack = 5 * um

local function flat(v) return vector(v.x, v.y, 0) end
local function cross(a, b) return a.x * b.y - a.y * b.x end
local function turned(v, angle)
  local c, s = math.cos(angle), math.sin(angle)
  return vector(c * v.x - s * v.y, s * v.x + c * v.y, 0)
end

--- "1,0.5,0.3; -1,0,0.2": x,y,radius in mm, world, as they are at the beginning.
function retina_zones.read(text)
  local zones = {}
  for part in (text .. ";"):gmatch "%s*([^;]*);" do
    if part:match "%S" then
      local x, y, radius = part:match "^%s*([-%d.eE]+)%s*,%s*([-%d.eE]+)%s*,%s*([%d.eE]+)%s*$"
      if not (tonumber(x) and tonumber(y) and tonumber(radius)) then
        error(("zones: %q is not x,y,radius in mm"):format(part), 0)
      end
      zones[#zones + 1] = { x = tonumber(x) * mm, y = tonumber(y) * mm, radius = tonumber(radius) * mm }
    end
  end
  return zones
end

--- Whether the segment between two places of the plane comes within a zone's `clear` of its `at`, more than a place on its edge.
local function blocks(zone, from, to)
  local way, towards = to - from, zone.at - from
  local length = way:norm()
  if length == 0 then return false end
  local along = math.max(0, math.min(1, (towards.x * way.x + towards.y * way.y) / length ^ 2))
  return (zone.at - (from + way * along)):norm() < zone.clear - slack
end

-- Out of a zone by the shortest way, where a place lies in it.
local function outside(zones, place)
  for _, zone in ipairs(zones) do
    local away = place - zone.at
    local far = away:norm()
    if far < zone.clear then place = zone.at + (far > 0 and away * (zone.clear / far) or vector(zone.clear, 0, 0)) end
  end
  return place
end

-- Towards `goal`, or along the tangent of the nearest zone in the way. The side is chosen once, by where the goal lies.
local function direction(zones, place, goal)
  local nearest, least
  for _, zone in ipairs(zones) do
    local far = (zone.at - place):norm()
    if blocks(zone, place, goal) and (not least or far < least) then
      nearest, least = zone, far
    end
  end
  local way = goal - place
  if not nearest then return way * (1 / way:norm()), way:norm() end
  local towards = nearest.at - place
  nearest.side = nearest.side or (cross(towards, way) >= 0 and 1 or -1)
  local tangent = turned(towards * (1 / least), nearest.side * math.asin(math.min(1, nearest.clear / least)))
  return tangent, math.huge
end

--- One step of at most `step` from `place` towards `goal` (m, over the retina; heights are not looked at) that enters no zone of
--- `zones` ({at =, clear =}: center and radius that the robot's center keeps). A place in a zone is led out at once.
function retina_zones.step(zones, place, goal, step)
  place, goal = flat(place), flat(goal)
  local inside = outside(zones, place) - place
  if inside:norm() > slack then
    local out = inside:norm()
    return place + inside * (math.min(step, out) / out)
  end
  if (goal - place):norm() == 0 or step == 0 then return place end
  local way, most = direction(zones, place, goal)
  if most < math.huge then
    for _, zone in ipairs(zones) do
      zone.side = nil
    end
  end
  return outside(zones, step < most and place + way * step or goal)
end

--- The number of the zone in which a place lies, if any.
function retina_zones.inside(zones, place)
  for number, zone in ipairs(zones) do
    if (flat(place) - zone.at):norm() < zone.clear - slack then return number end
  end
  return nil
end

return retina_zones
