-- The eye of a simulated rig: that of the rig file, or one with unknown parameters. A laboratory rig keeps its own.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm = units.mm

local eyes = {}

--- The parameter `eye` of a protocol.
function eyes.parameter(default)
  local choices = { "nominal", "perturbed" }
  return { choices = choices, default = default, help = "on a simulated rig: as believed, or off by table 5.1" }
end

--- The parameter `draw` of a protocol: `number` of eyes.set.
eyes.draw = { default = 1, min = 1, max = 1000000, integer = true, help = "which of the seed's perturbed eyes" }

--- Sets the eye of a simulated rig. `kind`: "nominal", or "perturbed": all of table 5.1 at once, Gaussian, one sigma each;
--- `number` chooses among the run's draws. Returns the true eye where it is known, for judging only. A laboratory rig has
--- the eye that it has.
function eyes.set(rig, run, kind, number)
  if not rig.simulation then
    if kind ~= "nominal" then run:note "the eye is as it is: eye=perturbed is for simulated rigs" end
    return nil
  end
  local eye = rig:eye()
  if kind == "perturbed" then eye = eye:sample { number = number or 1 } end
  rig.simulation:set_eye(eye)
  return eye
end

--- The parameters by which an eye differs from the one believed, as rows of a table.
function eyes.differences(believed, eye)
  local rows, nominal = {}, believed:info().parameters
  for name, value in pairs(eye:info().parameters) do
    local before = nominal[name]
    if value ~= before and before == before then
      local length = name:match "radius$" or name:match "thickness$"
      local function shown(number) return length and ("%.5g mm"):format(number / mm) or ("%.5g"):format(number) end
      rows[#rows + 1] = { name, shown(before), shown(value), ("%+.3g %%"):format(100 * (value / before - 1)) }
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
