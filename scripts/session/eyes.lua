-- The eye of a simulated rig: that of the rig file, one with unknown parameters, or one of another build than is believed. A
-- laboratory rig keeps its own.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm = units.mm

local eyes = {}

--- The parameter `eye` of a protocol.
function eyes.parameter(default)
  return {
    choices = { "nominal", "perturbed", "toric", "liou_brennan" },
    default = default,
    help = "on a simulated rig: as believed, off by table 5.1, that with an astigmatic cornea, or a gradient lens",
  }
end

--- The parameter `draw` of a protocol: `number` of eyes.set.
eyes.draw = { default = 1, min = 1, max = 1000000, integer = true, help = "which of the seed's perturbed eyes" }

--- Whether an eye of this kind is another one than the rig believes.
function eyes.differs(kind) return kind ~= "nominal" end

-- Corneal astigmatism of 23 239 eyes: 0.98 D in the mean (Hoffmann & Hütz 2010, J Cataract Refract Surg 36:1479). Where both
-- of its parts, across and oblique, are normal with one sigma, it follows Rayleigh's distribution, whose mean is
-- sigma sqrt(pi / 2).
local astigmatism = 0.98 / math.sqrt(math.pi / 2) -- 1/m

-- Size and direction of eye `number`'s: the R2 sequence (Roberts 2018), which fills the square evenly from any number on.
local function cylinder(number)
  local plastic = 1.32471795724474602596
  local size, turn = number / plastic % 1, number / plastic ^ 2 % 1
  return astigmatism * math.sqrt(-2 * math.log(1 - size)), math.pi * turn
end

-- The same eye with a cylinder on its cornea's front: the power (n - 1) / R kept in the mean, more of it along x, less along y
-- of the surface, which is turned.
local function with_astigmatism(eye, number)
  local made, rows = eye:prescription(), {}
  for _, row in ipairs(made.rows) do
    rows[row.surface] = row
  end
  local front, index = rows["cornea.anterior"], rows["cornea.posterior"].index
  local size, turn = cylinder(number)
  local power, half = (index - 1) / front.radius, size / 2 * (front.radius < 0 and -1 or 1)
  front.radius, front.radius_y = (index - 1) / (power + half), (index - 1) / (power - half)
  front.conic_y, front.tilt_z = front.conic, turn
  made.name, made.title = made.name .. "_toric", ("%s, %.2f D of astigmatism"):format(made.title, size)
  return optics.system(made)
end

-- Liou and Brennan's gradient eye in the believed one's cavity: the same retina.
local function gradient_eye(believed)
  local known = believed:prescription()
  if known.name ~= "navarro_condensing" then
    error("eye: liou_brennan is for a rig that believes in navarro_condensing, not in " .. known.name, 0)
  end
  return optics.system({ name = "liou_brennan_condensing" }):with {
    ["retina.radius"] = known.rows[1].radius,
    ["retina.conic"] = known.rows[1].conic or 0,
  }
end

--- Sets the eye of a simulated rig. `kind`: "nominal"; "perturbed": all of table 5.1 at once, Gaussian, one sigma each; "toric":
--- that with an astigmatic cornea; "liou_brennan": so off, Liou and Brennan's eye with its gradient lens, for a rig that believes
--- in Navarro's. `number` chooses among the run's draws. Returns the true eye where it is known, for judging only. A
--- laboratory rig has the eye that it has.
function eyes.set(rig, run, kind, number)
  if not rig.simulation then
    if kind ~= "nominal" then run:note(("the eye is as it is: eye=%s is for simulated rigs"):format(kind)) end
    return nil
  end
  local eye = rig:eye()
  if kind == "liou_brennan" then eye = gradient_eye(eye) end
  if eyes.differs(kind) then eye = eye:sample { number = number or 1 } end
  if kind == "toric" then eye = with_astigmatism(eye, number or 1) end
  rig.simulation:set_eye(eye)
  return eye
end

local function shown(name, number)
  if not number then return "–" end
  local length = name:match "radius" or name:match "thickness$"
  return length and ("%.5g mm"):format(number / mm) or ("%.5g"):format(number)
end

--- The parameters by which an eye differs from the one believed, as rows of a table: what only one of them has too, unless it is
--- nothing (a term that is 0, a plane).
function eyes.differences(believed, eye)
  local rows, names, before, after = {}, {}, believed:info().parameters, eye:info().parameters
  for name in pairs(after) do
    names[#names + 1] = name
  end
  for name, value in pairs(before) do
    if after[name] == nil and value ~= 0 and value < math.huge then names[#names + 1] = name end
  end
  table.sort(names)
  for _, name in ipairs(names) do
    local was, is = before[name], after[name]
    local nothing = was == nil and (is == 0 or is == math.huge)
    local same = is == was or (is ~= is and was ~= was) -- not a number is what nothing is known of
    if not same and not nothing and name ~= "stop.surface" then
      local both = was and is and was ~= 0
      rows[#rows + 1] = { name, shown(name, was), shown(name, is), both and ("%+.3g %%"):format(100 * (is / was - 1)) or "" }
    end
  end
  return rows
end

--- The table of what eyes.differences finds; nothing where no true eye is known or nothing differs.
function eyes.report(run, believed, eye)
  if not eye then return end
  local rows = eyes.differences(believed, eye)
  if #rows > 0 then
    run:table {
      title = "The eye on the bench, which the loop does not know",
      header = { "parameter", "believed", "true", "differs by" },
      rows = rows,
    }
  end
end

return eyes
