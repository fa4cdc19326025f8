-- Depth from focus with the instruments: the sensor's stage moves through focus, and the sharpest position is found with its
-- uncertainty (thesis 4.1, figure 4.1). Distances are d_ls, m, from the condensing lens' last vertex to the sensor.
-- SPDX-License-Identifier: Apache-2.0
local statistics = require "analysis.statistics"
local vision = require "vision"
local focusing = {}

-- Which of the stage's axes focuses, as the rig file says.
local function focus_axis(rig)
  local wanted = rig:model().focus_axis
  for i, axis in ipairs(rig.stage:info().axes) do
    if axis.name == wanted then return i end
  end
  error(("the stage has no axis %s, which the rig file calls its focus_axis"):format(wanted), 0)
end

--- The stage's position for a distance d_ls: the rig file's microscope.focus is where the stage's zero is.
function focusing.stage_position(rig, distance) return distance - rig:model().microscope.focus end

--- The distance d_ls at which the stage stands now.
function focusing.distance(rig) return rig:model().microscope.focus + rig.stage:position()[focus_axis(rig)] end

--- Moves the sensor to a distance d_ls, and waits until it is there.
function focusing.move(rig, distance)
  local target = rig.stage:position()
  target[focus_axis(rig)] = focusing.stage_position(rig, distance)
  rig.stage:move_to(target)
end

-- A window's corner and size, cut to the image; an error when nothing of it is in there.
local function cut(window, width, height)
  local x, y = math.max(0, math.floor(window.u - window.size / 2)), math.max(0, math.floor(window.v - window.size / 2))
  local right, bottom = math.min(width, x + window.size), math.min(height, y + window.size)
  if right - x < 16 or bottom - y < 16 then
    error(("the window at (%.0f, %.0f) px is outside of the image of %d x %d px"):format(window.u, window.v, width, height), 3)
  end
  return { x = x, y = y, width = math.floor(right - x), height = math.floor(bottom - y) }
end

--- Goes from..to in `steps` positions and takes `frames` images at each; the k-th images together are one sweep, so there
--- are as many repetitions. `window` = {u, v, size} in px. Returns {peaks, distances, values}: what vision.focus_peak says
--- of each sweep, and the first sweep's values.
function focusing.sweep(rig, options)
  local distances, values = statistics.range(options.from, options.to, options.steps), {}
  local frames = options.frames or 1
  for k = 1, frames do
    values[k] = {}
  end
  for i, distance in ipairs(distances) do
    focusing.move(rig, distance)
    for k = 1, frames do
      local frame = rig.top_camera:grab { fresh = k == 1 }
      local window = cut(options.window, frame.width_px, frame.height_px)
      window.measure = options.measure
      values[k][i] = frame.image:focus(window).value
    end
  end
  local peaks = {}
  for k = 1, frames do
    peaks[k] = vision.focus_peak { positions = distances, values = values[k] }
  end
  return { peaks = peaks, distances = distances, values = values[1] }
end

--- The distance of the sharpest of `steps` positions, one image each: where a finer sweep is to look.
function focusing.coarse(rig, options)
  local sweep = focusing.sweep(
    rig,
    { from = options.from, to = options.to, steps = options.steps, window = options.window, measure = options.measure }
  )
  local best = 1
  for i = 2, #sweep.values do
    if sweep.values[i] > sweep.values[best] then best = i end
  end
  return sweep.distances[best]
end

--- Of the sweeps that found their peak, mean and standard deviation (the GUM's type A: of one sweep), `count` of them, and
--- how many `failed`. Without a mean where none did.
function focusing.summary(peaks)
  local found, claimed = {}, {}
  for _, peak in ipairs(peaks) do
    if peak.answer == "found" then
      found[#found + 1], claimed[#claimed + 1] = peak.position, peak.sigma
    end
  end
  if #found == 0 then return { count = 0, failed = #peaks } end
  return {
    mean = statistics.mean(found),
    deviation = statistics.deviation(found),
    claimed = statistics.mean(claimed),
    count = #found,
    failed = #peaks - #found,
  }
end

--- Coarse to fine with vision.autofocus about `near`, ± `reach`. Returns what the search says, parked at the best place;
--- its position and sigma are d_ls.
function focusing.autofocus(rig, options)
  local search = vision.autofocus {
    low = options.near - options.reach,
    high = options.near + options.reach,
    step = options.step or 50e-6,
    strategy = options.strategy,
    repeats = options.repeats,
    coarse = math.max(11, math.ceil(2 * options.reach / (options.coarse_step or 250e-6)) + 1),
  }
  local step = search:next()
  while step.move_to do
    focusing.move(rig, step.move_to)
    local frame = rig.top_camera:grab { fresh = true }
    local window = cut(options.window, frame.width_px, frame.height_px)
    window.measure = options.measure
    step = search:next { position = step.move_to, value = frame.image:focus(window).value }
  end
  if step.park then focusing.move(rig, step.park) end
  return step
end

--- Where a point of the eye shows on the sensor that is in focus on it: {u, v} in px of its aerial image {x, y, d_ls}.
function focusing.pixel(rig, image)
  local model = rig:model()
  return { u = model.center_px[1] - image.x / model.pixel, v = model.center_px[2] + image.y / model.pixel }
end

--- The aerial image's {x, y}, m, of a pixel: the inverse of focusing.pixel.
function focusing.aerial(rig, u, v)
  local model = rig:model()
  return { x = (model.center_px[1] - u) * model.pixel, y = (v - model.center_px[2]) * model.pixel }
end

return focusing
