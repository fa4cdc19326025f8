-- Acceptance of a calibration: each measured number with its limits, and the file that keeps the accepted ones for the next
-- start.
-- SPDX-License-Identifier: Apache-2.0
local files = require "files"
local json = require "json"
local acceptance = {}
acceptance.__index = acceptance

--- An empty list of numbers to accept or refuse; `title` is that of its table in the report.
function acceptance.new(run, title)
  return setmetatable({ run = run, title = title, rows = {}, values = {}, files = {}, parts = {}, refused = 0 }, acceptance)
end

--- One number: { name =, value =, unit =, least =, most =, believed = } in SI; `key` is where it stands in the rig file, for
--- those that go into the calibration file. Numbers of one `part` (such as a camera: a pixel, and how well it was fitted) go into
--- it together or not at all. Returns whether it is accepted.
function acceptance:check(row)
  local well = row.value == row.value and row.value >= (row.least or -math.huge) and row.value <= (row.most or math.huge)
  local function shown(value) return value and format_quantity(value, row.unit or "", 4) or "–" end
  self.rows[#self.rows + 1] = {
    row.name,
    shown(row.believed),
    shown(row.value),
    row.sigma and "± " .. shown(row.sigma) or "–",
    shown(row.least) .. " to " .. shown(row.most),
    well and "accepted" or "refused",
  }
  if not well then
    self.refused = self.refused + 1
    if row.part then self.parts[row.part] = "refused" end
  end
  if well and row.key then self.values[row.key] = { value = row.value, part = row.part } end
  return well
end

--- A file of the run's folder that a key of the rig file is to name, such as a field calibration.
function acceptance:keep(key, name) self.files[key] = name end

--- The numbers by key, without those of a part of which something was refused.
function acceptance:accepted()
  local values = {}
  for key, found in pairs(self.values) do
    if not (found.part and self.parts[found.part]) then values[key] = found.value end
  end
  return values
end

--- The table, a result, calibration.json in the run's folder: { values = { [key of the rig file] = number }, ... }, and the same
--- into the rig's calibration file, where the rig names one. Refused numbers are not in it. Returns whether all were accepted.
function acceptance:close()
  local values = self:accepted()
  self.run:table {
    title = self.title,
    header = { "what", "believed", "measured", "one sigma", "limits", "" },
    rows = self.rows,
  }
  self.run:result("calibrations_refused", self.refused)
  files.write(
    "calibration.json",
    json.text { title = self.title, accepted = self.refused == 0, values = values, files = self.files } .. "\n"
  )
  local installed = self.run:install_calibration { values = values, files = self.files }
  if installed then self.run:note("the next start takes what was accepted from " .. installed) end
  if self.refused > 0 then
    self.run:note(("%d of %d numbers were refused: the rig stays as it was in these"):format(self.refused, #self.rows))
  end
  return self.refused == 0
end

return acceptance
