-- Bar charts with a name at each bar, as an SVG document for run:picture (run:plot has numbers on both axes).
-- SPDX-License-Identifier: Apache-2.0
local bars = {}

local colors = { "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728" }

local function escaped(text)
  return (tostring(text):gsub('[&<>"]', { ["&"] = "&amp;", ["<"] = "&lt;", [">"] = "&gt;", ['"'] = "&quot;" }))
end

local function finite(value) return type(value) == "number" and value == value and math.abs(value) < math.huge end

-- The largest value to draw, and a step of 1, 2 or 5 that divides it into at most six.
local function scale(rows, divisor)
  local largest = 0
  for _, row in ipairs(rows) do
    for _, value in pairs(row.values) do
      if finite(value) then largest = math.max(largest, value / divisor) end
    end
  end
  if largest <= 0 then largest = 1 end
  local ten = 10 ^ math.floor(math.log(largest / 6, 10))
  for _, factor in ipairs { 1, 2, 5, 10 } do
    if largest <= 6 * factor * ten then return largest, factor * ten end
  end
end

local function line_of_text(out, x, y, text, anchor)
  out[#out + 1] = ('<text x="%.1f" y="%.1f" text-anchor="%s">%s</text>'):format(x, y, anchor or "start", escaped(text))
end

local function bar(out, x, y, width, color, shown)
  out[#out + 1] = ('<rect x="%.1f" y="%.1f" width="%.1f" height="9" fill="%s"/>'):format(x, y, width, color)
  line_of_text(out, x + width + 4, y + 8.5, shown)
end

--- The chart as a text of SVG. `rows` is a list of { name =, values = { ... } } in SI, none negative; a value that is missing
--- (false, or not finite) is shown as a dash. `labels` says what the values are, `unit` and `divisor` (one unit in SI) how
--- they are shown, `title` what stands above.
function bars.svg(options)
  local rows, labels, divisor = options.rows, options.labels, options.divisor or 1
  local left, across, tall = 190, 440, 10 * #labels + 8
  local first = options.title and 22 or 0
  local top = first + 14 + 14 * #labels
  local bottom = top + tall * #rows
  local out = {
    (
      '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 %d %d" width="%d" height="%d" '
      .. 'font-family="sans-serif" font-size="10"><rect width="100%%" height="100%%" fill="white"/>'
    ):format(left + across + 70, bottom + 34, left + across + 70, bottom + 34),
  }
  if options.title then
    out[#out + 1] = ('<text x="6" y="16" font-size="12" font-weight="bold">%s</text>'):format(escaped(options.title))
  end
  for i, label in ipairs(labels) do
    local y = first + 14 * i
    out[#out + 1] = ('<rect x="%d" y="%d" width="10" height="9" fill="%s"/>'):format(left, y - 6, colors[i])
    line_of_text(out, left + 16, y + 2.5, label)
  end
  local largest, step = scale(rows, divisor)
  for k = 0, math.floor(largest / step + 1e-9) do
    local x = left + across * k * step / largest
    out[#out + 1] = ('<path d="M%.1f %d V%d" stroke="#ccc"/>'):format(x, top, bottom)
    line_of_text(out, x, bottom + 12, ("%g"):format(k * step), "middle")
  end
  line_of_text(out, left + across / 2, bottom + 27, options.unit or "", "middle")
  for i, row in ipairs(rows) do
    local y = top + tall * (i - 1)
    line_of_text(out, left - 6, y + tall / 2 + 4, row.name, "end")
    for k = 1, #labels do
      local value = row.values[k]
      local known = finite(value)
      bar(
        out,
        left,
        y + 4 + 10 * (k - 1),
        known and across * math.max(value, 0) / divisor / largest or 0,
        colors[k],
        known and ("%.3g"):format(value / divisor) or "–"
      )
    end
  end
  out[#out + 1] = "</svg>"
  return table.concat(out, "\n")
end

return bars
