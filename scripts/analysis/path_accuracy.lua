-- Accuracy of a servoed path: results, tables and plots from the recorded streams, by the simulator's truth where there is
-- one, else by the side camera (x and z only).
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local judge = {}

local um = units.um

-- Thesis table 5.4, experiment 1 (robot along x), in m: mean, standard deviation, maximum.
judge.thesis = { lateral = { 93 * um, 49 * um, 248 * um }, depth = { 249 * um, 177 * um, 721 * um } }

local function in_um(value) return ("%.0f"):format(value / um) end

local function mean_and_max(mean, deviation, max) return { in_um(mean) .. " ± " .. in_um(deviation), in_um(max) } end

-- Whether the record has a stream; no sample of it is read.
local function recorded(run, stream) return run:samples(stream, {}, { from = run:now() }) ~= nil end

local told = false -- in this run

--- Which stream tells where the robot really was, and what to call it. Where that is not the truth, the record says so once.
function judge.reference(run)
  if recorded(run, "truth") then return "truth", "simulator's truth" end
  if recorded(run, "side_camera") then
    if not told then run:note("errors are judged by the side camera, in x and z: there is no truth here") end
    told = true
    return "side_camera", "side camera"
  end
  error("there is neither a truth nor a side camera to judge by", 2)
end

--- Whether there is a stream to judge by.
function judge.has_reference(run) return recorded(run, "truth") or recorded(run, "side_camera") end

--- How far the robot was from its path in a span {from, to}, and the localization from the robot, as run:errors tells:
--- {path, localization}.
function judge.measure(run, span)
  local reference = judge.reference(run)
  local path = run:errors { of = reference, against = "servo", against_prefix = "target_", from = span.from, to = span.to }
  return { path = path, localization = run:errors { of = "servo", against = reference, from = span.from, to = span.to } }
end

--- States the errors of judge.measure as the run's results, and returns them.
function judge.results(run, span)
  local found = judge.measure(run, span)
  local path, localization = found.path, found.localization
  run:headline(("Path followed to %.0f µm rms, localized to %.0f µm"):format(path.rms / um, localization.mean / um))
  run:result("path_error_rms", path.rms, "m")
  run:result("path_error_lateral_rms", path.lateral_rms, "m")
  run:result("path_error_depth_rms", path.depth_rms, "m")
  run:result("localization_error_mean", localization.mean, "m")
  run:result("localization_error_max", localization.max, "m")
  return found
end

--- The table of the localization error, lateral and in depth, beside the thesis'; `found` as run:errors gives it.
function judge.localization_table(run, found)
  local thesis = judge.thesis
  local function row(name, mean, deviation, max, printed)
    local cells = { name, table.unpack(mean_and_max(mean, deviation, max)) }
    for _, cell in ipairs(mean_and_max(table.unpack(printed))) do
      cells[#cells + 1] = cell
    end
    return cells
  end
  run:table {
    title = "Localization error, beside thesis table 5.4 (experiment 1, robot along x)",
    header = { "axis", "mean, µm", "max, µm", "thesis mean, µm", "thesis max, µm" },
    rows = {
      row("lateral", found.lateral_mean, found.lateral_std, found.lateral_max, thesis.lateral),
      row("depth", found.depth_mean, found.depth_std, found.depth_max, thesis.depth),
    },
  }
end

-- Two channels of a stream in the path's time, as x and y of a series.
local function series(run, span, stream, x, y, label, mark)
  local seen = run:samples(stream, { x, y }, span)
  return { label = label, mark = mark, x = seen[x], y = seen[y] }
end

local function trajectory(run, span, title, axis, shown)
  local reference, name = judge.reference(run)
  local all = {}
  if shown[reference] then all[1] = series(run, span, reference, "x", axis, name) end
  all[#all + 1] = series(run, span, "servo", "x", axis, "top camera", "points")
  all[#all + 1] = series(run, span, "servo", "target_x", "target_" .. axis, "target", "dashed")
  run:plot { title = title, x = { "x", "mm" }, y = { axis, "mm" }, equal_aspect = true, series = all }
end

-- Reference less the servo's channel along each axis, at the servo's times `time`; the reference is taken at its nearest
-- sample. NaN where there is none.
local function offsets(run, span, prefix, axes)
  local channels, offset = {}, {}
  for i, axis in ipairs(axes) do
    channels[i] = prefix .. axis
  end
  local reference, seen = run:samples(judge.reference(run), axes, span), run:samples("servo", channels, span)
  local truth_times, servo_times = reference.time, seen.time
  for _, axis in ipairs(axes) do
    local truth, servo = reference[axis], seen[prefix .. axis]
    local near = 1
    offset[axis] = {}
    for i = 1, #servo do
      while near < #truth and math.abs(truth_times[near + 1] - servo_times[i]) <= math.abs(truth_times[near] - servo_times[i]) do
        near = near + 1
      end
      offset[axis][i] = truth[near] and truth[near] - servo[i] or 0 / 0
    end
  end
  offset.time = servo_times
  return offset
end

-- The axes that the reference has.
local function axes_of(run) return judge.reference(run) == "truth" and { "x", "y", "z" } or { "x", "z" } end

--- Rms of the robot's distance from its target in a span {from, to} when its place is taken as its mean over `window`
--- seconds: what the loop is off by of a robot that goes to and fro as it swims. m.
function judge.mean_way(run, options, window)
  local span, axes = { from = options.from, to = options.to }, axes_of(run)
  local offset, first, sums, squares, count = offsets(run, span, "target_", axes), 1, {}, 0, 0
  for i, time in ipairs(offset.time) do
    for _, axis in ipairs(axes) do
      sums[axis] = (sums[axis] or 0) + offset[axis][i]
    end
    while offset.time[first] <= time - window do
      for _, axis in ipairs(axes) do
        sums[axis] = sums[axis] - offset[axis][first]
      end
      first = first + 1
    end
    if first > 1 then -- a whole window
      count = count + 1
      for _, axis in ipairs(axes) do
        squares = squares + (sums[axis] / (i - first + 1)) ^ 2
      end
    end
  end
  if count == 0 then error("the span is shorter than the window", 2) end
  return math.sqrt(squares / count)
end

--- Distances of the robot's place from the servo's ("") or from its target ("target_") in a span {from, to}: a series of
--- times x and values y.
function judge.distances(run, options, prefix)
  local axes = axes_of(run)
  local offset, distance = offsets(run, { from = options.from, to = options.to }, prefix, axes), {}
  for i in ipairs(offset.time) do
    local squares = 0
    for _, axis in ipairs(axes) do
      squares = squares + offset[axis][i] ^ 2
    end
    distance[i] = squares ^ 0.5
  end
  return { x = offset.time, y = distance }
end

--- What is left of a robot that is held, in a span {from, to}: `scatter`, rms of its distance from its own mean place, m, which
--- the control is to answer for, and `sigmas`, how far that mean is from the target along the axis where it is farthest, over
--- the standard deviation that the record states there: what the view is off by, which no control can see.
function judge.at_rest(run, options)
  local span, axes = { from = options.from, to = options.to }, axes_of(run)
  local offset = offsets(run, span, "target_", axes)
  local variance, sigmas = 0, 0
  for _, axis in ipairs(axes) do
    local stated = run:samples("servo", { "sigma_" .. axis }, span)["sigma_" .. axis]
    local sum, squares, sigma, count = 0, 0, 0, 0
    for i, value in ipairs(offset[axis]) do
      if value == value and stated[i] == stated[i] then
        sum, squares, sigma, count = sum + value, squares + value ^ 2, sigma + stated[i], count + 1
      end
    end
    if count == 0 then error("the robot is not seen along " .. axis, 2) end
    variance = variance + math.max(0, squares / count - (sum / count) ^ 2)
    sigmas = math.max(sigmas, math.abs(sum) / sigma)
  end
  return { scatter = math.sqrt(variance), sigmas = sigmas }
end

local function error_plot(run, span, which)
  local path = judge.distances(run, span, "target_")
  local localization = judge.distances(run, span, "")
  path.label, localization.label = "from the path", "of the localization"
  localization.mark = "points"
  -- Sideways and in depth together, as the distance is: roots of sums of squares of table 5.4's.
  local lateral, depth = judge.thesis.lateral, judge.thesis.depth
  local mean, deviation = math.sqrt(lateral[1] ^ 2 + depth[1] ^ 2), math.sqrt(lateral[2] ^ 2 + depth[2] ^ 2)
  run:plot {
    title = "Error against time" .. which,
    x = { "time", "s" },
    y = { "error", "um" },
    series = { path, localization },
    expected = {
      {
        label = ("localization in the thesis: %.0f ± %.0f µm (table 5.4)"):format(mean / um, deviation / um),
        low = mean - deviation,
        high = mean + deviation,
      },
    },
  }
end

local function currents_plot(run, span, which)
  local all, currents = {}, run:samples("currents", nil, span)
  for coil = 1, 8 do
    all[coil] = { label = "coil " .. coil, x = currents.time, y = currents["i" .. coil] }
  end
  run:plot { title = "Currents against time" .. which, x = { "time", "s" }, y = { "current", "A" }, series = all }
end

--- The plots of a path in a span {from, to}: trajectories, errors and currents against time. `which`: of several rounds, for
--- the titles, such as ", eye 3".
function judge.plots(run, span, which)
  which = which or ""
  trajectory(run, span, "Trajectory from above" .. which, "y", { truth = true })
  trajectory(run, span, "Trajectory in depth" .. which, "z", { truth = true, side_camera = true })
  error_plot(run, span, which)
  currents_plot(run, span, which)
end

--- Results, table and plots of the time from options.from to options.to; returns the errors of judge.measure.
function judge.path(run, options)
  local span = { from = options.from, to = options.to }
  local found = judge.results(run, span)
  local path = found.path
  judge.localization_table(run, found.localization)
  judge.plots(run, span)
  run:note(("rms error %.0f µm, sideways %.0f µm, over %d frames"):format(path.rms / um, path.lateral_rms / um, path.count))
  return found
end

return judge
