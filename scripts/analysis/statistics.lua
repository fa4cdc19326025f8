-- Statistics of lists of numbers, and random numbers from the run's seed.
-- SPDX-License-Identifier: Apache-2.0
local statistics = {}

local function some(values, what)
  if type(values) ~= "table" or #values == 0 then error(what .. ": wants a list with at least one number", 3) end
  return values
end

--- The arithmetic mean; an error for an empty list.
function statistics.mean(values)
  local sum = 0
  for _, value in ipairs(some(values, "mean")) do
    sum = sum + value
  end
  return sum / #values
end

--- Standard deviation of a sample (n - 1); 0 of a single number.
function statistics.deviation(values)
  local mean, squares = statistics.mean(values), 0
  for _, value in ipairs(values) do
    squares = squares + (value - mean) ^ 2
  end
  return #values > 1 and math.sqrt(squares / (#values - 1)) or 0
end

--- The root of the mean square: about zero, not about the mean.
function statistics.rms(values)
  local squares = 0
  for _, value in ipairs(some(values, "rms")) do
    squares = squares + value ^ 2
  end
  return math.sqrt(squares / #values)
end

--- The largest of a list.
function statistics.max(values) return math.max(table.unpack(some(values, "max"))) end

--- The smallest of a list.
function statistics.min(values) return math.min(table.unpack(some(values, "min"))) end

--- The value below which a part (0 to 1) of them lies, linear between neighbors.
function statistics.percentile(values, part)
  if not (part >= 0 and part <= 1) then error("percentile: part: wants 0 to 1, got " .. tostring(part), 2) end
  local sorted = table.move(some(values, "percentile"), 1, #values, 1, {})
  table.sort(sorted)
  local at = 1 + part * (#sorted - 1)
  local below = math.floor(at)
  local above = math.min(below + 1, #sorted)
  return sorted[below] + (at - below) * (sorted[above] - sorted[below])
end

--- The middle value, or the mean of the two in the middle.
function statistics.median(values) return statistics.percentile(values, 0.5) end

--- Independent uncertainties together (GUM 5.1.2): the root of the sum of squares.
function statistics.combined(...)
  local squares = 0
  for _, value in ipairs { ... } do
    squares = squares + value ^ 2
  end
  return math.sqrt(squares)
end

--- The straight line y = intercept + slope x, least squares, and the largest distance from it.
function statistics.line(x, y)
  if #some(x, "line") < 2 or #x ~= #y then error("line: wants two lists of the same length, two or more", 2) end
  local mean_x, mean_y, across, along = statistics.mean(x), statistics.mean(y), 0, 0
  for i = 1, #x do
    across = across + (x[i] - mean_x) * (y[i] - mean_y)
    along = along + (x[i] - mean_x) ^ 2
  end
  if along == 0 then error("line: all x are alike", 2) end
  local slope = across / along
  local intercept, worst = mean_y - slope * mean_x, 0
  for i = 1, #x do
    worst = math.max(worst, math.abs(y[i] - intercept - slope * x[i]))
  end
  return { slope = slope, intercept = intercept, max_residual = worst }
end

--- The same of data of which up to a quarter may be far off: the median of the slopes of all pairs (Theil 1950, Sen 1968), and
--- the median of what is left. Pairs whose x differ by less than `apart` (0) say nothing of the slope.
function statistics.robust_line(x, y, apart)
  if #some(x, "robust_line") < 2 or #x ~= #y then error("robust_line: wants two lists of the same length, two or more", 2) end
  local slopes, left = {}, {}
  for i = 1, #x do
    for k = i + 1, #x do
      local across = x[k] - x[i]
      if math.abs(across) > (apart or 0) then slopes[#slopes + 1] = (y[k] - y[i]) / across end
    end
  end
  if #slopes == 0 then error("robust_line: all x are alike", 2) end
  local slope = statistics.median(slopes)
  for i = 1, #x do
    left[i] = y[i] - slope * x[i]
  end
  return { slope = slope, intercept = statistics.median(left) }
end

--- `count` values from `first` to `last`, both among them.
function statistics.range(first, last, count)
  if count < 1 then error("range: count: wants at least 1", 2) end
  local values = {}
  for i = 1, count do
    values[i] = count == 1 and first or first + (last - first) * (i - 1) / (count - 1)
  end
  return values
end

--- A number of the standard normal distribution.
function statistics.normal() return math.sqrt(-2 * math.log(1 - math.random())) * math.cos(2 * math.pi * math.random()) end

--- f of each, as a list.
function statistics.map(values, f)
  local made = {}
  for i, value in ipairs(values) do
    made[i] = f(value, i)
  end
  return made
end

return statistics
