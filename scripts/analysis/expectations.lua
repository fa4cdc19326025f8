-- Expectations: what the thesis printed, what came out here, how far apart they may be, and why they differ where they do.
-- A protocol opens a book, enters each number, and ends with book:close(): a table in the report, the rows for
-- `vitreo reproduce` in expectations.json, and the counts of each verdict as results. Numbers in SI.
-- SPDX-License-Identifier: Apache-2.0
local files = require "files"
local json = require "json"

local expect = {}
local book = {}
book.__index = book

-- The bound, the spread or the digits that a number is judged by.
local function tolerance_text(row)
  local function shown(value) return format_quantity(value, row.unit) end
  local whose = row.printed and "printed: " or ""
  if row.spread then return ("printed ± %s, twice"):format(shown(row.spread)) end
  if row.within then return "± " .. shown(row.within) end
  if row.error then return "the thesis' own error" end
  if row.at_most and row.at_least then return ("%s%s to %s"):format(whose, shown(row.at_least), shown(row.at_most)) end
  if row.at_most then return whose .. "at most " .. shown(row.at_most) end
  if row.at_least then return whose .. "at least " .. shown(row.at_least) end
  return "none"
end

-- As it stands in the table: "differs, 4.1 spreads".
local function verdict_text(row) return row.verdict .. (row.deviation and (", %.1f spreads"):format(row.deviation) or "") end

-- What came out here, where something did.
local function answer_text(row)
  local there = row.ours == row.ours and math.abs(row.ours) ~= math.huge
  return there and format_quantity(row.ours, row.unit) or "no answer"
end

--- Opens a book. `where` names the table or figure that the rows belong to, unless a row names its own.
function expect.book(run, where) return setmetatable({ run = run, where = where, rows = {}, known = {} }, book) end

--- One number: { id =, what =, thesis = (may be left out), ours =, unit = "" (SI: m, rad, m/s), why = "" }, and what it is
--- judged by (run:judge): `spread` printed with the thesis' number, or `within` what its digits or words leave;
--- `error = "eye, calibration and pixels"`: the same error as the thesis', with that noise and doubt in it; or a bound of one's
--- own, at_most =, at_least =, where the thesis has no number, and `printed = true` where the bound is its own words. None of
--- them: shown. `reason` says where the measure is from; `values` are those of which `ours` is the median, for a number
--- joined over several runs (scripts/reproduction.lua).
function book:number(row)
  if type(row.id) ~= "string" or row.id == "" then error("expect: id: wants a name", 2) end
  if self.known[row.id] then error("expect: id: " .. row.id .. " comes twice", 2) end
  if type(row.ours) ~= "number" then error("expect: " .. row.id .. ": ours: wants a number, got " .. type(row.ours), 2) end
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
    error = row.error,
    spread = row.spread,
    within = row.within,
    at_most = row.at_most,
    at_least = row.at_least,
    printed = row.printed,
    values = row.values,
  }
  if row.error and made.reason == "" then made.reason = "in ours: " .. row.error end
  local judged, problem = pcall(self.run.judge, self.run, {
    ours = row.ours == row.ours and math.abs(row.ours) ~= math.huge and row.ours or nil,
    thesis = row.thesis,
    spread = row.spread,
    within = row.within,
    at_most = row.at_most,
    at_least = row.at_least,
    printed = row.printed,
    same_error = row.error ~= nil,
  })
  if not judged then error("expect: " .. row.id .. ": " .. tostring(problem), 2) end
  made.verdict, made.deviation = problem.verdict, problem.deviation
  made.tolerance = tolerance_text(made)
  self.rows[#self.rows + 1] = made
  return made.verdict
end

--- How many rows there are of each verdict: {["goal met"] = 3, reproduced = 1}.
function book:count()
  local count = {}
  for _, row in ipairs(self.rows) do
    count[row.verdict] = (count[row.verdict] or 0) + 1
  end
  return count
end

--- Ends the protocol's report: the table, two results, and the rows as data.
function book:close()
  local cells, data = {}, {}
  for i, row in ipairs(self.rows) do
    local why = row.why
    if row.reason ~= "" then why = (why == "" and "" or why .. "; ") .. "measure: " .. row.reason end
    cells[i] = {
      row.where,
      row.what,
      row.thesis and format_quantity(row.thesis, row.unit) or "–",
      answer_text(row),
      row.tolerance,
      verdict_text(row),
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
      deviation = row.deviation,
      why = row.why,
      reason = row.reason,
      values = row.values,
    }
  end
  self.run:table {
    title = "Beside the thesis",
    header = { "where", "what", "thesis", "ours", "measure", "verdict", "why" },
    rows = cells,
  }
  files.write("expectations.json", json.text(data) .. "\n")
  -- Counted apart: a goal of our own that is met says nothing about the thesis.
  local count = self:count()
  for _, verdict in ipairs { "reproduced", "better", "goal met", "goal missed", "differs", "shown" } do
    local always = verdict == "goal missed" or verdict == "differs"
    if count[verdict] or always then self.run:result("verdict_" .. verdict:gsub(" ", "_"), count[verdict] or 0) end
  end
  for _, row in ipairs(self.rows) do
    if row.verdict == "differs" or row.verdict == "goal missed" then
      self.run:note(
        ("%s: %s here, %s in the thesis, %s: %s"):format(
          row.what,
          answer_text(row),
          row.thesis and format_quantity(row.thesis, row.unit) or "–",
          row.tolerance,
          verdict_text(row)
        )
      )
    end
  end
end

return expect
