-- Parts of protocols/drift_test: random directions, the values found, and the report beside thesis table 6.1.
-- SPDX-License-Identifier: Apache-2.0
local expect = require "analysis.expectations"
local statistics = require "analysis.statistics"
local units = require "units"
local places = require "places"
local um, s = units.um, units.s
local drift = {}

--- What the field follows, as the report says it.
drift.names = {
  none = "constant currents",
  one_camera = "one camera",
  two_cameras = "two cameras",
  pose_sensor = "pose sensor",
}
local names = drift.names

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

-- What table 6.1 has at a place with this feedback, in m/s: {mean, sd}; nil for a feedback that it has not.
local function printed_at(kind, place)
  local cell = places.table_6_1[place.name][kind]
  return cell and { mean = cell[1] * um, sd = cell[2] * um }
end

-- "within 1 sd", "within 2 sd" or "differs": of the printed spread.
local function nearness(ours, printed)
  local deviation = math.abs(ours - printed.mean) / printed.sd
  return (deviation <= 1 and "within 1 sd" or deviation <= 2 and "within 2 sd" or "differs") .. (", %.1f"):format(deviation)
end

-- Each cell: the machines' median, and where a tenth and nine tenths of them lie.
local function rows_of(found, asked)
  local rows = {}
  for i, place in ipairs(found.six) do
    local row = { place.name }
    for _, kind in ipairs(asked) do
      local speeds, printed = found[kind][place.name], printed_at(kind, place)
      local middle = statistics.median(speeds)
      row[#row + 1] = ("%s (%s to %s)"):format(
        in_um(middle),
        in_um(statistics.percentile(speeds, 0.1)),
        in_um(statistics.percentile(speeds, 0.9))
      )
      row[#row + 1] = printed and ("%s ± %s"):format(in_um(printed.mean), in_um(printed.sd)) or "–"
      row[#row + 1] = printed and nearness(middle, printed) or "–"
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
    table.move({ names[kind] .. " (10 to 90 %)", "thesis", "deviation" }, 1, 3, #header + 1, header)
  end
  table.move({ "disturbance canceled", "place held" }, 1, 2, #header + 1, header)
  return header
end

-- The mean over the edge's three places over that of the middle's, and the thesis' with what its spreads make of it.
local function edge_over_middle(found, kind)
  local ours, printed, variance = { 0, 0 }, { 0, 0 }, { 0, 0 }
  for _, place in ipairs(found.six) do
    local at, cell = place.edge and 1 or 2, printed_at(kind, place)
    ours[at] = ours[at] + statistics.median(found[kind][place.name])
    if cell then
      printed[at], variance[at] = printed[at] + cell.mean, variance[at] + cell.sd ^ 2
    end
  end
  local ratio = printed[1] / printed[2] -- its variance, first order, of independent cells
  local spread = ratio * (variance[1] / printed[1] ^ 2 + variance[2] / printed[2] ^ 2) ^ 0.5
  return { ours = ours[1] / ours[2], thesis = ratio, spread = spread }
end

-- The largest over the places (`only`: those for which it holds) of the machines' median.
local function largest(found, kind, only)
  local most = 0
  for _, place in ipairs(found.six) do
    if not only or only(place) then most = math.max(most, statistics.median(found[kind][place.name])) end
  end
  return most
end

local function smallest(found, kind)
  local least = math.huge
  for _, place in ipairs(found.six) do
    least = math.min(least, statistics.median(found[kind][place.name]))
  end
  return least
end

-- The largest ratio, at the edge, of a drift with feedback to that without; and how far one camera is from two.
local function between_kinds(found)
  local ratio, apart = 0, 0
  for _, place in ipairs(found.six) do
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
  for _, kind in ipairs(asked) do
    run:result("edge_over_middle_" .. kind, edge_over_middle(found, kind).ours, "")
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

-- Why a cell may differ: one machine was measured for the thesis, and where is not told.
local function cause(found, kind, place)
  local speeds = found[kind][place.name]
  return ("machines lie from %s to %s µm/s (10 to 90 %%), the thesis' spread is of five runs of one; %s"):format(
    in_um(statistics.percentile(speeds, 0.1)),
    in_um(statistics.percentile(speeds, 0.9)),
    place.edge and ("it gives no coordinates: %.1f mm aside here"):format(place.position[1] / units.mm)
      or "what its trim left at the center is not told"
  )
end

-- Each cell of table 6.1 by its printed spread, the shape of the table, and this project's goals.
local function expected(run, found, asked)
  local book = expect.book(run, "table 6.1")
  local edge = found.six[#found.six].position[1] / units.mm
  local at_edge = edge == 4 and "" or (".edge_%gmm"):format(edge) -- the plan has one run an edge
  for _, kind in ipairs(asked) do
    for _, place in ipairs(found.six) do
      local printed = printed_at(kind, place)
      if printed then
        book:number {
          id = ("6.1.%s.%s%s"):format(kind, place.name, at_edge),
          what = ("%s, %s"):format(place.name, names[kind]),
          thesis = printed.mean,
          spread = printed.sd,
          ours = statistics.median(found[kind][place.name]),
          unit = "m/s",
          why = cause(found, kind, place),
        }
      end
    end
    if places.table_6_1["middle-middle"][kind] then
      local shape = edge_over_middle(found, kind)
      book:number {
        id = ("6.1.edge_over_middle.%s%s"):format(kind, at_edge),
        what = ("edge over middle, %s"):format(names[kind]),
        thesis = shape.thesis,
        spread = shape.spread,
        ours = shape.ours,
        why = "what the trim leaves is everywhere alike, what the field's model is off by grows with the distance: "
          .. "docs/figures.md has both apart",
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
    id = "6.1.hold" .. at_edge,
    what = "held by the estimator, worst place",
    where = "goal",
    ours = largest(found, "hold"),
    unit = "m/s",
    at_most = 5 * um / s,
    reason = "this project's goal",
  }
  book:number {
    id = "6.1.cancel" .. at_edge,
    what = "disturbance canceled, place left alone, worst place",
    where = "goal",
    ours = largest(found, "cancel"),
    unit = "m/s",
  }
  book:close()
end

local function plot(run, found, asked)
  local series = {}
  for _, kind in ipairs(asked) do
    local x, y, printed, low, high = {}, {}, {}, {}, {}
    for i, place in ipairs(found.six) do
      local cell = printed_at(kind, place)
      x[i], y[i] = i, statistics.median(found[kind][place.name])
      if cell then
        printed[i], low[i], high[i] = cell.mean, cell.mean - cell.sd, cell.mean + cell.sd
      end
    end
    series[#series + 1] = { label = names[kind], x = x, y = y }
    if #printed == #x then
      local bounds = { x = {}, y = {} } -- from one bound to the other, over each place
      for i = 1, #x do
        table.move({ x[i], x[i], 0 / 0 }, 1, 3, #bounds.x + 1, bounds.x)
        table.move({ low[i], high[i], 0 / 0 }, 1, 3, #bounds.y + 1, bounds.y)
      end
      series[#series + 1] = { label = "thesis, " .. names[kind], x = x, y = printed, mark = "points" }
      series[#series + 1] = { label = "its spread", x = bounds.x, y = bounds.y }
    end
  end
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
    title = ("Drift in µm/s: medians over %d machine(s), %d run(s) each, beside thesis table 6.1 (sd: its spread)"):format(
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
