-- Parts of protocols/drift_test: random directions, the values found, and the report beside thesis table 6.1.
-- SPDX-License-Identifier: Apache-2.0
local expect = require "analysis.expectations"
local statistics = require "analysis.statistics"
local units = require "units"
local places = require "places"
local um, s = units.um, units.s
local drift = {}

local names = { none = "constant currents", one_camera = "one camera", two_cameras = "two cameras" }

--- A unit vector, all directions alike.
function drift.any_direction()
  local direction
  repeat
    direction = vector(statistics.normal(), statistics.normal(), statistics.normal())
  until direction:norm() > 1e-3
  return direction / direction:norm()
end

--- The place of a value in a list; nil where it is not in it.
function drift.index(list, wanted)
  for i, one in ipairs(list) do
    if one == wanted then return i end
  end
end

--- Puts a value into the list found[kind][place], which is made where it is missing.
function drift.add(found, kind, place, value)
  found[kind] = found[kind] or {}
  found[kind][place] = found[kind][place] or {}
  table.insert(found[kind][place], value)
end

-- Where the robot was last, and when: by the simulator's truth where there is one, else as the top camera saw it.
local function latest(run, since)
  local channels, span = { "x", "y", "z" }, { from = since, to = run:now() }
  local seen = run:samples("truth", channels, span) or run:samples("servo", channels, span)
  for i = #seen.time, 1, -1 do
    if seen.x[i] == seen.x[i] then return vector(seen.x[i], seen.y[i], seen.z[i]), seen.time[i] end
  end
  error("the robot was not seen lately", 0)
end

--- Mean velocity over `time`, in m/s: of the simulator's truth where there is one, else as the top camera sees it.
function drift.velocity(run, time)
  local from, started = latest(run, run:now() - 0.5 * s)
  run:wait(time)
  local to, ended = latest(run, run:now() - 0.5 * s)
  return (to - from) / (ended - started)
end

local function in_um(value, digits) return ("%." .. (digits or 0) .. "f"):format(value / um) end

local function rows_of(found, asked)
  local rows = {}
  for i, place in ipairs(places.six) do
    local row, thesis = { place.name }, places.table_6_1[place.name]
    for _, kind in ipairs(asked) do
      row[#row + 1] = in_um(statistics.median(found[kind][place.name]))
      row[#row + 1] = tostring(thesis[kind])
    end
    row[#row + 1] = in_um(statistics.median(found.cancel[place.name]), 1)
    row[#row + 1] = in_um(statistics.median(found.hold[place.name]), 1)
    rows[i] = row
  end
  return rows
end

local function header_of(asked)
  local header = { "place" }
  for _, kind in ipairs(asked) do
    header[#header + 1] = names[kind]
    header[#header + 1] = "thesis"
  end
  header[#header + 1] = "disturbance canceled"
  header[#header + 1] = "place held"
  return header
end

-- The largest over the places (`only`: those for which it holds) of the machines' median.
local function largest(found, kind, only)
  local most = 0
  for _, place in ipairs(places.six) do
    if not only or only(place) then most = math.max(most, statistics.median(found[kind][place.name])) end
  end
  return most
end

local function smallest(found, kind)
  local least = math.huge
  for _, place in ipairs(places.six) do
    least = math.min(least, statistics.median(found[kind][place.name]))
  end
  return least
end

-- The largest ratio, at the edge, of a drift with feedback to that without; and how far one camera is from two.
local function between_kinds(found)
  local ratio, apart = 0, 0
  for _, place in ipairs(places.six) do
    local function of(kind) return statistics.median(found[kind][place.name]) end
    if place.edge then ratio = math.max(ratio, math.max(of "one_camera", of "two_cameras") / of "none") end
    apart = math.max(apart, math.abs(of "one_camera" - of "two_cameras"))
  end
  return ratio, apart
end

local function state_results(run, found, asked)
  for _, kind in ipairs(asked) do
    run:result("drift_" .. kind .. "_min", smallest(found, kind), "um/s")
    run:result("drift_" .. kind .. "_max", largest(found, kind), "um/s")
  end
  if #asked == 3 then
    local ratio, apart = between_kinds(found)
    run:result("drift_ratio_at_edge_max", ratio, "")
    run:result("drift_one_two_cameras_apart", apart, "um/s")
  end
  run:result("drift_cancel_max", largest(found, "cancel"), "um/s")
  run:result("drift_hold_max", largest(found, "hold"), "um/s")
  local worst = 0
  for _, speeds in pairs(found.hold) do
    for _, speed in ipairs(speeds) do
      worst = math.max(worst, speed)
    end
  end
  run:result("drift_hold_worst_machine", worst, "um/s")
end

-- Each place beside table 6.1, printed, and this project's goals over them.
local function expected(run, found, asked)
  local book = expect.book(run, "table 6.1")
  local all = {
    none = { 100 * um / s, 800 * um / s },
    one_camera = { 30 * um / s, 250 * um / s },
    two_cameras = { 30 * um / s, 250 * um / s },
  }
  for _, kind in ipairs(asked) do
    for _, place in ipairs(places.six) do
      book:number {
        id = ("6.1.%s.%s"):format(kind, place.name),
        what = ("%s, %s"):format(place.name, names[kind]),
        thesis = places.table_6_1[place.name][kind] * um,
        ours = statistics.median(found[kind][place.name]),
        unit = "m/s",
        between = all[kind],
        reason = "this project's goal; the thesis' own spread is not printed",
        why = place.edge and "the thesis gives no coordinates: 3.5 mm aside is as far as a robot placed by hand stays in sight"
          or nil,
      }
    end
  end
  if #asked == 3 then
    local ratio, apart = between_kinds(found)
    book:number {
      id = "6.1.ratio",
      what = "at the edge, feedback over constant currents, largest",
      where = "goal",
      ours = ratio,
      at_most = 0.6,
      reason = "this project's goal",
    }
    book:number {
      id = "6.1.apart",
      what = "one camera from two cameras, largest",
      where = "goal",
      ours = apart,
      unit = "m/s",
      at_most = 60 * um / s,
      reason = "this project's goal",
    }
  end
  book:number {
    id = "6.1.hold",
    what = "held by the estimator, worst place",
    where = "goal",
    ours = largest(found, "hold"),
    unit = "m/s",
    at_most = 5 * um / s,
    reason = "this project's goal",
  }
  book:number {
    id = "6.1.cancel",
    what = "disturbance canceled, place left alone, worst place",
    where = "goal",
    ours = largest(found, "cancel"),
    unit = "m/s",
  }
  book:close()
end

local function plot(run, found, asked)
  local series, marks = {}, {}
  for _, kind in ipairs(asked) do
    local x, y, printed = {}, {}, {}
    for i, place in ipairs(places.six) do
      x[i], y[i], printed[i] = i, statistics.median(found[kind][place.name]), places.table_6_1[place.name][kind] * um
    end
    series[#series + 1] = { label = names[kind], x = x, y = y }
    marks[#marks + 1] = { label = "thesis, " .. names[kind], x = x, y = printed, mark = "dashed" }
  end
  table.move(marks, 1, #marks, #series + 1, series)
  run:plot {
    title = "Drift at the six places, in the table's order",
    x = { "place", "" },
    y = { "drift", "um/s" },
    series = series,
  }
end

--- Table, plot and results: medians over the machines of the mean over the repetitions.
function drift.report(run, found, asked, counts)
  run:table {
    title = ("Drift in µm/s: medians over %d machine(s), %d run(s) each, beside thesis table 6.1"):format(
      counts.machines,
      counts.repetitions
    ),
    header = header_of(asked),
    rows = rows_of(found, asked),
  }
  plot(run, found, asked)
  state_results(run, found, asked)
  expected(run, found, asked)
end

return drift
