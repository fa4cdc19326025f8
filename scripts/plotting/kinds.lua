-- Kinds of plots beyond lines, for the report: histogram, points with error bars, heat map, a trajectory in two views, and
-- measured beside expected values. Numbers are SI; axes are {label, unit} as run:plot takes them.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"

local plots = {}

local function finite(value) return type(value) == "number" and value == value and math.abs(value) < math.huge end

local function needed(options, call, names)
  for _, name in ipairs(names) do
    if options[name] == nil then error("plots." .. call .. ": " .. name .. " is missing", 3) end
  end
end

local function range_of(values, call)
  local low, high = math.huge, -math.huge
  for _, value in ipairs(values) do
    if finite(value) then
      low, high = math.min(low, value), math.max(high, value)
    end
  end
  if low > high then error("plots." .. call .. ": there is no finite number to draw", 3) end
  return low, high
end

--- How often values fall into each of `bins` (20) equal parts of their range. `values`, `x` and `title` are needed.
function plots.histogram(run, options)
  needed(options, "histogram", { "values", "x", "title" })
  local bins = options.bins or 20
  local low, high = range_of(options.values, "histogram")
  if high == low then
    low, high = low - 0.5, high + 0.5
  end
  local counts = {}
  for bin = 1, bins do
    counts[bin] = 0
  end
  for _, value in ipairs(options.values) do
    if finite(value) then
      local bin = math.min(bins, 1 + math.floor((value - low) / (high - low) * bins))
      counts[bin] = counts[bin] + 1
    end
  end
  local x, y = { low }, { 0 }
  for bin = 1, bins do
    local left, right = low + (bin - 1) / bins * (high - low), low + bin / bins * (high - low)
    x[#x + 1], y[#y + 1] = left, counts[bin]
    x[#x + 1], y[#y + 1] = right, counts[bin]
  end
  x[#x + 1], y[#y + 1] = high, 0
  run:plot {
    title = options.title,
    x = options.x,
    y = { "count", "" },
    series = { { label = options.label, x = x, y = y } },
    note = options.note,
  }
  return counts
end

--- Points with a bar of one `sigma` up and down, with caps. `x_values`, `y_values`, `sigma`, `x`, `y` and `title` are needed;
--- `expected` as run:plot takes it.
function plots.error_bars(run, options)
  needed(options, "error_bars", { "x_values", "y_values", "sigma", "x", "y", "title" })
  local x, y, sigma = options.x_values, options.y_values, options.sigma
  if #x ~= #y or #x ~= #sigma then error("plots.error_bars: x_values, y_values and sigma differ in length", 2) end
  run:plot {
    title = options.title,
    x = options.x,
    y = options.y,
    series = { { label = options.label or "mean ± one standard deviation", x = x, y = y, spread = sigma, mark = "points" } },
    expected = options.expected,
    note = options.note,
  }
end

-- From dark to light, for the color-blind too (viridis).
local shades = {
  { 68, 1, 84 },
  { 71, 44, 122 },
  { 59, 81, 139 },
  { 44, 113, 142 },
  { 33, 144, 141 },
  { 39, 173, 129 },
  { 92, 200, 99 },
  { 170, 220, 50 },
  { 253, 231, 37 },
}

local function shade(part)
  local at = math.max(0, math.min(1, part)) * (#shades - 1)
  local low = math.min(math.floor(at), #shades - 2)
  local from, to, mix = shades[low + 1], shades[low + 2], at - low
  local color = {}
  for i = 1, 3 do
    color[i] = math.floor(from[i] + (to[i] - from[i]) * mix + 0.5)
  end
  return ("#%02x%02x%02x"):format(color[1], color[2], color[3])
end

local function escaped(text)
  return (tostring(text):gsub('[&<>"]', { ["&"] = "&amp;", ["<"] = "&lt;", [">"] = "&gt;", ['"'] = "&quot;" }))
end

local function text(out, x, y, anchor, shown, more)
  out[#out + 1] = ('<text x="%.1f" y="%.1f" text-anchor="%s"%s>%s</text>'):format(x, y, anchor, more or "", escaped(shown))
end

local function in_unit(value, axis)
  local name = (axis[2] or ""):gsub("/", "_per_"):gsub("%^", "")
  return ("%.3g"):format(name == "" and value or value / units[name])
end

local function titled(axis) return (axis[2] or "") == "" and axis[1] or axis[1] .. " (" .. axis[2] .. ")" end

local function color_bar(out, x, top, tall, low, high, axis)
  for i = 0, 49 do
    out[#out + 1] = ('<rect x="%d" y="%.1f" width="14" height="%.1f" fill="%s"/>'):format(
      x,
      top + tall * (49 - i) / 50,
      tall / 50 + 0.5,
      shade(i / 49)
    )
  end
  text(out, x + 18, top + 9, "start", in_unit(high, axis))
  text(out, x + 18, top + tall, "start", in_unit(low, axis))
  text(out, x + 7, top - 6, "middle", titled(axis))
end

--- `rows` of values as colors, the first row at the bottom; a value that is missing (false, or not finite) stays white.
--- `x_range` and `y_range` are {from, to}; `rows`, `x`, `y`, `value` (an axis) and `title` are needed.
function plots.heat_map(run, options)
  needed(options, "heat_map", { "rows", "x_range", "y_range", "x", "y", "value", "title" })
  local rows, all = options.rows, {}
  for _, row in ipairs(rows) do
    if #row ~= #rows[1] then error("plots.heat_map: rows differ in length", 2) end
    for _, value in ipairs(row) do
      if finite(value) then all[#all + 1] = value end
    end
  end
  local low, high = range_of(all, "heat_map")
  local left, top, across, tall = 70, 44, 440, 280
  local out = {
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 620 376" width="620" height="376" shape-rendering="crispEdges" '
      .. 'font-family="sans-serif" font-size="11"><rect width="100%" height="100%" fill="white"/>',
  }
  text(out, 8, 18, "start", options.title, ' font-size="13" font-weight="bold"')
  local wide, high_cell = across / #rows[1], tall / #rows
  for r, row in ipairs(rows) do
    for c, value in ipairs(row) do
      if finite(value) then
        out[#out + 1] = ('<rect x="%.2f" y="%.2f" width="%.2f" height="%.2f" fill="%s"/>'):format(
          left + (c - 1) * wide,
          top + tall - r * high_cell,
          wide + 0.3,
          high_cell + 0.3,
          shade(high > low and (value - low) / (high - low) or 0.5)
        )
      end
    end
  end
  out[#out + 1] = ('<rect x="%d" y="%d" width="%d" height="%d" fill="none" stroke="#444"/>'):format(left, top, across, tall)
  for i = 0, 4 do
    local x = options.x_range[1] + (options.x_range[2] - options.x_range[1]) * i / 4
    local y = options.y_range[1] + (options.y_range[2] - options.y_range[1]) * i / 4
    text(out, left + across * i / 4, top + tall + 15, "middle", in_unit(x, options.x))
    text(out, left - 6, top + tall - tall * i / 4 + 4, "end", in_unit(y, options.y))
  end
  text(out, left + across / 2, top + tall + 34, "middle", titled(options.x))
  text(out, 14, top + tall / 2, "middle", titled(options.y), (' transform="rotate(-90 14 %d)"'):format(top + tall // 2))
  color_bar(out, left + across + 26, top + 12, tall - 12, low, high, options.value)
  out[#out + 1] = "</svg>"
  run:picture { title = options.title, svg = table.concat(out, "\n") }
end

--- Trajectories from above and from the side, at one scale. `paths` is a list of { label =, points = list of positions,
--- mark = }; `title` and `unit` ("mm") say the rest.
function plots.trajectory(run, options)
  needed(options, "trajectory", { "paths", "title" })
  local unit = options.unit or "mm"
  for _, view in ipairs { { "from above", "y", 2 }, { "from the side", "z", 3 } } do
    local series = {}
    for i, path in ipairs(options.paths) do
      local x, other = {}, {}
      for k, point in ipairs(path.points) do
        x[k], other[k] = point[1], point[view[3]]
      end
      series[i] = { label = path.label, x = x, y = other, mark = path.mark }
    end
    run:plot {
      title = options.title .. ", " .. view[1],
      x = { "x", unit },
      y = { view[2], unit },
      series = series,
      equal_aspect = true,
      note = options.note,
    }
  end
end

--- A table of what was measured beside what was expected: `rows` of { name, measured, expected, within, unit }. Returns
--- whether all of them are within; those that are become no results by this.
function plots.expected(run, options)
  needed(options, "expected", { "rows", "title" })
  local rows, all = {}, true
  for i, row in ipairs(options.rows) do
    local name, measured, expected, within, unit = row[1], row[2], row[3], row[4], row[5] or ""
    local good = finite(measured) and math.abs(measured - expected) <= within
    all = all and good
    rows[i] = {
      name,
      finite(measured) and format_quantity(measured, unit) or "–",
      format_quantity(expected, unit),
      "± " .. format_quantity(within, unit),
      good and "within" or "NOT within",
    }
  end
  run:table { title = options.title, header = { "", "measured", "expected", "allowed", "" }, rows = rows }
  return all
end

return plots
