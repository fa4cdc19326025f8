-- Acceptance of a calibration: each measured number with the limits in which it is believed, and the file that keeps those that
-- are.
-- SPDX-License-Identifier: Apache-2.0
local files = require "files"
local json = require "json"
local acceptance = {}
acceptance.__index = acceptance

function acceptance.new(run, title)
  return setmetatable({ run = run, title = title, rows = {}, values = {}, refused = 0 }, acceptance)
end

--- One number: { name =, value =, unit =, least =, most =, believed = } in SI; `key` is where it stands in the rig file, for
--- those that go into the calibration file. Returns whether it is accepted.
function acceptance:check(row)
  local well = row.value == row.value and row.value >= (row.least or -math.huge) and row.value <= (row.most or math.huge)
  local function shown(value) return value and self.run:show(value, row.unit or "", 4) or "–" end
  self.rows[#self.rows + 1] = {
    row.name,
    shown(row.believed),
    shown(row.value),
    row.sigma and "± " .. shown(row.sigma) or "–",
    shown(row.least) .. " to " .. shown(row.most),
    well and "accepted" or "refused",
  }
  if not well then self.refused = self.refused + 1 end
  if well and row.key then self.values[row.key] = row.value end
  return well
end

--- A file of the run's folder that a key of the rig file is to name, such as a field calibration.
function acceptance:keep(key, name)
  self.files = self.files or {}
  self.files[key] = name
end

--- The table, a figure, and calibration.json in the run's folder: { values = { [key of the rig file] = number }, ... }. Refused
--- numbers are not in it. Returns whether all were accepted.
function acceptance:close()
  self.run:table {
    title = self.title,
    header = { "what", "believed", "measured", "one sigma", "limits", "" },
    rows = self.rows,
  }
  self.run:figure("calibrations_refused", self.refused)
  files.write(
    "calibration.json",
    json.text { title = self.title, accepted = self.refused == 0, values = self.values, files = self.files } .. "\n"
  )
  if self.refused > 0 then
    self.run:note(("%d of %d numbers were refused: the rig stays as it was in these"):format(self.refused, #self.rows))
  end
  return self.refused == 0
end

return acceptance
