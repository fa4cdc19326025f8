-- The endoilluminator's magnetic tip (thesis 7.4: "care needs to be taken not to approach close to the microrobot"): the field
-- that it adds where the robot is, what that does to the robot, and an interlock on the distance.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm = units.mm

local endoilluminator = {}
endoilluminator.__index = endoilluminator

local mu0 = 4e-7 * math.pi

-- A rod of soft steel, 20 G (0.9 mm), 3 mm of it near: assumed. In a field B it is magnetized by M = B / (mu0 N) along it, with
-- the demagnetizing factor N of a prolate spheroid of that shape (Osborn 1945), up to its saturation.
local tip = { radius = 0.45 * mm, length = 3 * mm, saturation = 1.7e6 }

local function demagnetization(aspect)
  local root = (aspect ^ 2 - 1) ^ 0.5
  return (aspect / root * math.log(aspect + root) - 1) / (aspect ^ 2 - 1)
end

--- A tip at `position` (world), from which the robot stays `margin` away, in a field of `field` T.
function endoilluminator.new(position, margin, field)
  local factor = demagnetization(tip.length / (2 * tip.radius))
  local moment = math.min(field / (mu0 * factor), tip.saturation) * math.pi * tip.radius ^ 2 * tip.length
  return setmetatable({ position = position, margin = margin, moment = moment, nearest = math.huge }, endoilluminator)
end

--- How far a place is from the tip, m.
function endoilluminator:distance(place) return (place - self.position):norm() end

--- At most, at that distance: {field, T, gradient, T/m}, on the axis of the tip's dipole.
function endoilluminator:background(distance)
  local field = mu0 * self.moment / (2 * math.pi * distance ^ 3)
  return { field = field, gradient = 3 * field / distance }
end

-- The distance of a point from the way between two others.
local function off_the_way(point, from, to)
  local way = to - from
  local length = way:norm()
  if length == 0 then return (point - from):norm() end
  local along = math.max(0, math.min(1, (point - from):dot(way) / length ^ 2))
  return (point - (from + way * along)):norm()
end

--- Refuses a way that comes nearer to the tip than the margin, before anything moves.
function endoilluminator:check_way(from, to)
  local near = off_the_way(self.position, from, to)
  if near >= self.margin then return end
  error(
    ("the way would come to %s from the endoilluminator's tip, and %s must be left: take the tip back, or go elsewhere"):format(
      format_quantity(near, "m"),
      format_quantity(self.margin, "m")
    ),
    0
  )
end

--- Watches the robot while the loop moves it: nearer than the margin, the loop is closed (the coils go to zero), an alarm is
--- raised, and an error names the distance. `moving()` says whether to go on.
function endoilluminator:watch(run, servo, moving)
  while moving() do
    local place = servo:status().position
    local distance = place and self:distance(place)
    if distance then self.nearest = math.min(self.nearest, distance) end
    if distance and distance < self.margin then
      servo:close()
      local text = ("the robot is %s from the endoilluminator's magnetic tip, %s must be left; the coils are at zero"):format(
        format_quantity(distance, "m"),
        format_quantity(self.margin, "m")
      )
      run:alarm { name = "endoilluminator", priority = "high", text = text }
      error(text, 0)
    end
    run:wait(0.05)
  end
end

return endoilluminator
