-- Expectations: what the thesis printed, what came out here, how far apart they may be, and why they differ where they do.
-- A protocol opens a book, enters each number, and ends with book:close(): a table in the report, the rows for
-- `vitreo reproduce` in expectations.json, and the verdicts as results. Numbers in SI.
-- SPDX-License-Identifier: Apache-2.0
local files = require "files"
local json = require "json"

local expect = {}
local book = {}
book.__index = book

-- Verdicts: "agrees" and "better" are well; "differs" and "worse" want a reason; "printed" is for what is only told.
local function judged(row)
  local ours, thesis = row.ours, row.thesis
  if ours ~= ours then return "no answer" end
  if row.within then return math.abs(ours - thesis) <= row.within and "agrees" or "differs" end
  if row.at_most then return ours <= row.at_most and "better" or "worse" end
  if row.at_least then return ours >= row.at_least and "better" or "worse" end
  if row.between then return ours >= row.between[1] and ours <= row.between[2] and "agrees" or "differs" end
  return "printed"
end

local function tolerance_text(row)
  local function shown(value) return format_quantity(value, row.unit) end
  if row.within then return "± " .. shown(row.within) end
  if row.at_most then return "at most " .. shown(row.at_most) end
  if row.at_least then return "at least " .. shown(row.at_least) end
  if row.between then return shown(row.between[1]) .. " to " .. shown(row.between[2]) end
  return "none"
end

--- Opens a book. `where` names the table or figure that the rows belong to, unless a row names its own.
function expect.book(run, where) return setmetatable({ run = run, where = where, rows = {}, known = {} }, book) end

--- One number: { id =, what =, thesis = (may be left out), ours =, unit = "" (SI: m, rad, m/s), why = "" } and one of
--- within = tolerance, at_most =, at_least =, between = { least, most }; none of them: printed only. `reason` says where
--- the tolerance is from; `values` are those of which `ours` is the median, for a number joined over several runs
--- (scripts/reproduction.lua).
function book:number(row)
  if type(row.id) ~= "string" or row.id == "" then error("expect: id: wants a name", 2) end
  if self.known[row.id] then error("expect: id: " .. row.id .. " comes twice", 2) end
  if type(row.ours) ~= "number" then error("expect: " .. row.id .. ": ours: wants a number, got " .. type(row.ours), 2) end
  if row.within and type(row.thesis) ~= "number" then error("expect: " .. row.id .. ": within wants the thesis' number", 2) end
  self.known[row.id] = true
  local made = {
    id = row.id,
    what = row.what or row.id,
    where = row.where or self.where,
    thesis = row.thesis,
    ours = row.ours,
    unit = row.unit or "",
    why = row.why or "",
    reason = row.reason or "",
    within = row.within,
    at_most = row.at_most,
    at_least = row.at_least,
    between = row.between,
    values = row.values,
  }
  made.verdict = judged(made)
  made.tolerance = tolerance_text(made)
  self.rows[#self.rows + 1] = made
  return made.verdict
end

--- How many rows are as they should be, and how many are not: {well, ill}.
function book:count()
  local well, ill = 0, 0
  for _, row in ipairs(self.rows) do
    if row.verdict == "agrees" or row.verdict == "better" then well = well + 1 end
    if row.verdict == "differs" or row.verdict == "worse" or row.verdict == "no answer" then ill = ill + 1 end
  end
  return { well = well, ill = ill }
end

--- Ends the protocol's report: the table, two results, and the rows as data.
function book:close()
  local cells, data = {}, {}
  for i, row in ipairs(self.rows) do
    local why = row.why
    if row.reason ~= "" then why = (why == "" and "" or why .. "; ") .. "tolerance: " .. row.reason end
    cells[i] = {
      row.where,
      row.what,
      row.thesis and format_quantity(row.thesis, row.unit) or "–",
      format_quantity(row.ours, row.unit),
      row.tolerance,
      row.verdict,
      why,
    }
    data[i] = {
      id = row.id,
      what = row.what,
      where = row.where,
      thesis = row.thesis or 0 / 0,
      ours = row.ours,
      unit = row.unit,
      tolerance = row.tolerance,
      verdict = row.verdict,
      why = row.why,
      reason = row.reason,
      values = row.values,
    }
  end
  self.run:table {
    title = "Beside the thesis",
    header = { "where", "what", "thesis", "ours", "tolerance", "verdict", "why" },
    rows = cells,
  }
  files.write("expectations.json", json.text(data) .. "\n")
  local count = self:count()
  self.run:result("expectations_met", count.well)
  self.run:result("expectations_missed", count.ill)
  for _, row in ipairs(self.rows) do
    if row.verdict == "differs" or row.verdict == "worse" or row.verdict == "no answer" then
      self.run:note(
        ("%s: %s here, %s in the thesis, tolerance %s: %s"):format(
          row.what,
          format_quantity(row.ours, row.unit),
          row.thesis and format_quantity(row.thesis, row.unit) or "–",
          row.tolerance,
          row.verdict
        )
      )
    end
  end
end

return expect
