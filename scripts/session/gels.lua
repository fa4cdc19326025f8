-- The gels of thesis figure 7.1: as a rheometer measured them, from a table, or as the simulator assumes them.
-- SPDX-License-Identifier: Apache-2.0
local files = require "files"
local published = require "analysis.published"

local gels = {}

-- What devices/sim assumes of the eleven cases (docs/simulated_laboratory.md): G' = 14 Pa (agar / 1.098)^2.6, 50 mPa s beside it.
local assumed = { modulus = 14, exponent = 2.6, viscosity = 50e-3, frequency = 1 }

--- The first `count` cases of tables 7.1 and 7.2: a list of { name, agar, storage, loss (Pa), frequency (Hz), vial (what
--- rig.sample:change_vial takes) }. The thesis has their moduli in a figure only: these are assumed.
function gels.assumed(count)
  local list = {}
  for number = 1, count do
    local agar = published.gels.agar[number]
    list[number] = {
      name = tostring(number),
      agar = agar,
      storage = assumed.modulus * (agar / published.gels.agar[1]) ^ assumed.exponent,
      loss = 2 * math.pi * assumed.frequency * assumed.viscosity,
      frequency = assumed.frequency,
      vial = { gel = "gel_" .. number },
    }
  end
  return list
end

--- A rheometer's table (CSV with the columns name, frequency_Hz, storage_Pa, loss_Pa, and agar_mg_per_mL if it is known): at most
--- `count` rows of it, as gels.assumed has them.
function gels.measured(path, count)
  local list = {}
  for number, row in ipairs(files.read_csv(path).rows) do
    if number > count then break end
    for _, column in ipairs { "frequency_Hz", "storage_Pa", "loss_Pa" } do
      local value = row[column]
      if not (type(value) == "number" and value > 0) then
        error(("rheometer: %s, row %d: %s wants a number above 0, got %s"):format(path, number, column, tostring(value)), 0)
      end
    end
    list[number] = {
      name = tostring(row.name or number),
      agar = row.agar_mg_per_mL,
      storage = row.storage_Pa,
      loss = row.loss_Pa,
      frequency = row.frequency_Hz,
      vial = { storage_modulus = row.storage_Pa, loss_modulus = row.loss_Pa, frequency = row.frequency_Hz },
    }
  end
  if #list == 0 then error("rheometer: " .. path .. " has no row", 0) end
  return list
end

return gels
