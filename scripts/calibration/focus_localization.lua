-- Localization by focus with calibration, for protocols/localize_by_focus: the assumed map, the measurements of a calibration,
-- positions from image points, and their uncertainty (thesis 4.3, 4.4; GUM). Eye frame, m.
-- SPDX-License-Identifier: Apache-2.0
local focusing = require "calibration.focus"
local published = require "analysis.published"
local statistics = require "analysis.statistics"
local targets = require "session.targets"
local units = require "units"
local vision = require "vision"
local mm, um = units.mm, units.um
local by_focus = {}

local window = 120 -- px
local retina_gap = 0.1 * mm -- a target on the retina is as far before it
local pixel_sigma = 0.5 -- px, of the target's center
-- 4.4.4: the retinal depth of the model eye was measured to 0.55 mm (33.1 mm), one of thirty; the mean of thirty:
local retina_sigma = 0.55 * mm / math.sqrt(30)

--- What is believed: the eye, its map, its law on the axis.
function by_focus.model(eye)
  return { eye = eye, map = eye:wide_angle_map { max_angle = 35 * units.deg, max_depth = 8 * mm }, law = eye:axis_law() }
end

-- Images of the target as the sensor is moved about `near`: peaks of each repetition.
local function sweep(rig, near, pixel, reach, steps, frames)
  return focusing.sweep(rig, {
    from = near - reach,
    to = near + reach,
    steps = steps,
    frames = frames,
    window = { u = pixel.u, v = pixel.v, size = window },
  })
end

-- Center of the target, px: what differs from the same view without it.
local function center(rig, place)
  targets.remove(rig)
  local tracker = vision.background_tracker { threshold = 12, max_area_px = 1e6 }
  for k = 1, 3 do
    tracker:learn(rig.top_camera:grab({ fresh = k == 1 }).image)
  end
  targets.put(rig, place)
  return tracker:update(rig.top_camera:grab({ fresh = true }).image)
end

-- Where the target at `place` was sharp and seen: {x, y, distance, deviation of one sweep, sigma of the mean}, or nothing.
local function see(rig, place, near, pixel, reach, steps, frames)
  targets.put(rig, place)
  local coarse = focusing.coarse(rig, {
    from = near - reach,
    to = near + reach,
    steps = math.ceil(reach / (0.2 * mm)) + 1,
    window = { u = pixel.u, v = pixel.v, size = window },
  })
  local found = focusing.summary(sweep(rig, coarse, pixel, 0.45 * mm, steps, frames).peaks)
  if found.count == 0 then return end
  focusing.move(rig, found.mean)
  local spot = center(rig, place)
  if not spot then return end
  local aerial = focusing.aerial(rig, spot.x_px, spot.y_px)
  local deviation = math.max(found.deviation, found.claimed / math.sqrt(found.count))
  return { x = aerial.x, y = aerial.y, distance = found.mean, deviation = deviation }
end

--- Thirty looks at a target. `calibration` tells where to look for it.
function by_focus.look(rig, model, calibration, place, p)
  local image = model.map:image(place)
  if not image then return end
  local near = by_focus.raw_distance(calibration, model, image)
  return see(rig, place, near, focusing.pixel(rig, image), 1 * mm, p.steps, p.repetitions)
end

-- Linear between neighbors, flat beyond the ends.
local function interpolated(list, at)
  if at <= list[1][1] then return list[1][2] end
  for i = 2, #list do
    if at <= list[i][1] then
      local part = (at - list[i - 1][1]) / (list[i][1] - list[i - 1][1])
      return list[i - 1][2] + part * (list[i][2] - list[i - 1][2])
    end
  end
  return list[#list][2]
end

--- Measured distances less believed ones: at the retina on the axis (4.3), along the axis (4.4.4), and along the retina.
--- `measure(place, near)` gives {x, y, distance}.
function by_focus.learn(model, angles, measure)
  local made = { axis = {}, shape = {} }
  local retina = vector(0, 0, retina_gap)
  local image = model.map:image(retina)
  local seen = measure(retina, image) or error("the target on the retina was not found sharp: nothing to calibrate on", 0)
  made.retina_shift = seen.distance - image.z
  for i, depth in ipairs { retina_gap, 1.5 * mm, 3 * mm, 4.5 * mm, 6 * mm } do
    local place = vector(0, 0, depth)
    local there = model.map:image(place)
    local got = i == 1 and seen or measure(place, vector(there.x, there.y, there.z + made.retina_shift))
    if got then made.axis[#made.axis + 1] = { got.distance, got.distance - there.z } end
  end
  for _, angle in ipairs(angles) do
    local place = angle > 0 and model.eye:point_at_field(angle, retina_gap)
    local there = place and model.map:image(place)
    local got = there and measure(place, vector(there.x, there.y, there.z + made.retina_shift))
    if got then
      local radius = math.sqrt(got.x ^ 2 + got.y ^ 2)
      made.shape[#made.shape + 1] =
        { radius, got.distance - there.z - made.retina_shift, radius / math.sqrt(there.x ^ 2 + there.y ^ 2) }
    end
  end
  table.insert(made.shape, 1, { 0, 0, made.shape[1] and made.shape[1][3] or 1 })
  return made
end

--- The calibration of by_focus.learn, measured with the instruments.
function by_focus.calibrate(rig, model, angles)
  local calibrated = false -- the first target, on the retina, is looked for in a wider range
  return by_focus.learn(model, angles, function(place, near)
    local seen = see(rig, place, near.z, focusing.pixel(rig, near), calibrated and 1.2 * mm or 2.4 * mm, 9, 3)
    calibrated = calibrated or seen ~= nil
    return seen
  end)
end

-- What has to be taken off a measured distance, by one of the calibrations.
local function correction(calibration, kind, distance, radius)
  if kind == "none" then return 0 end
  if kind == "retina" then return calibration.retina_shift end
  return interpolated(calibration.axis, distance) + interpolated(calibration.shape, radius)
end

--- Where the sensor will be, for a believed image.
function by_focus.raw_distance(calibration, _, image)
  return image.z + correction(calibration, "full", image.z + calibration.retina_shift, math.sqrt(image.x ^ 2 + image.y ^ 2))
end

--- A place from what was seen; with error against the known one and the uncertainty by the GUM: scatter of focus (type A),
--- the center's half pixel, and what the retinal depth was known to (type B). Nothing outside the map.
function by_focus.locate(model, calibration, seen, place, kind)
  local radius = math.sqrt(seen.x ^ 2 + seen.y ^ 2)
  local scale = kind == "full"
      and interpolated(statistics.map(calibration.shape, function(one) return { one[1], one[3] } end), radius)
    or 1
  local distance = seen.distance - correction(calibration, kind, seen.distance, radius)
  local found = model.map:locate(
    { seen.x / scale, seen.y / scale, distance },
    { image_sigma = math.max(pixel_sigma * 9.9 * um, 1e-9), focus_sigma = math.max(seen.deviation, 1e-9) }
  )
  if not found then return end
  return {
    place = place,
    found = found.position,
    error = (found.position - place):norm(),
    uncertainty = statistics.combined(found.sigma:norm(), retina_sigma),
  }
end

--- Figure 4.11's comparison: first order for the points on the retina: depth by the law on the axis, height by magnification.
function by_focus.paraxial(eye, model, angles)
  local z, x = {}, {}
  for i, angle in ipairs(angles) do
    local place = eye:point_at_field(angle, retina_gap)
    local image = place and model.map:image(place)
    local depth = image and model.law:depth(image.z)
    local first = depth and eye:axial_image(depth)
    z[i], x[i] = depth or 0 / 0, first and math.abs(image.x / first.magnification) or 0 / 0
  end
  return { z = z, x = x }
end

-- Median error over the places in one computed eye, by each calibration.
local function one_eye(eye, model, angles, surfaces, focus_sigma)
  local map = eye:wide_angle_map { max_angle = 35 * units.deg, max_depth = 8 * mm }
  local function measure(place)
    local image = map:image(place)
    if not image then return end
    local blur = pixel_sigma * 9.9 * um
    return {
      x = image.x + blur * statistics.normal(),
      y = image.y + blur * statistics.normal(),
      distance = image.z + focus_sigma * statistics.normal(),
      deviation = focus_sigma,
    }
  end
  local calibration = by_focus.learn(model, angles, measure)
  local errors = { none = {}, retina = {}, full = {} }
  for _, angle in ipairs(angles) do
    for _, depth in ipairs(surfaces) do
      local place = eye:point_at_field(angle, depth)
      local seen = place and measure(place)
      for kind, list in pairs(errors) do
        local cell = seen and by_focus.locate(model, calibration, seen, place, kind)
        if cell then list[#list + 1] = cell.error end
      end
    end
  end
  return errors
end

--- The thesis' experiment with its noise: in `count` eyes off by table 5.1 the images computed, focus scattered by what the
--- thesis calls its variance to be expected (4.4.3), axis and retinal shape calibrated. Mean error over the places, median of the
--- eyes.
function by_focus.with_printed_scatter(book, believed, model, angles, surfaces, count)
  local means = {}
  for number = 1, count do
    local eye = believed:sample { number = number }
    local made, errors = pcall(one_eye, eye, model, angles, surfaces, published.chapter_4.model_eye.depth_of_focus)
    if made and #errors.full > 0 then means[#means + 1] = statistics.mean(errors.full) end
  end
  if #means == 0 then return end
  book:number {
    id = "4.1.mean_with_scatter",
    what = ("mean error, focus scattered as in the thesis, median of %d eyes"):format(#means),
    thesis = published.table_4_1.mean,
    ours = statistics.median(means),
    unit = "m",
    error = "eyes off by table 5.1, calibration with that scatter, pixels",
    why = "the eye of table 5.3, not chapter 4's undisclosed lens",
  }
end

--- Twenty eyes, all of table 5.1 at once, their images computed through their own maps with the scatter that was measured:
--- medians and 90th percentiles over the eyes of each eye's median error.
function by_focus.many_eyes(run, book, believed, model, angles, surfaces, count, focus_sigma)
  local medians = { none = {}, retina = {}, full = {} }
  for number = 1, count do
    local made, errors = pcall(one_eye, believed:sample { number = number }, model, angles, surfaces, focus_sigma)
    if made then
      for kind, list in pairs(errors) do
        if #list > 0 then table.insert(medians[kind], statistics.median(list)) end
      end
    else
      run:note(("eye %d: %s"):format(number, tostring(errors)))
    end
  end
  local rows = {}
  for i, one in ipairs { { "none", "uncalibrated" }, { "retina", "the retina alone" }, { "full", "axis and retinal shape" } } do
    local list = medians[one[1]]
    rows[i] = {
      one[2],
      #list,
      format_quantity(statistics.median(list), "m"),
      format_quantity(statistics.percentile(list, 0.9), "m"),
      format_quantity(statistics.max(list), "m"),
    }
  end
  run:table {
    title = ("Median error of %d eyes off by table 5.1, images computed"):format(count),
    header = { "calibration", "eyes", "median of eyes", "90 %", "worst eye" },
    rows = rows,
  }
  book:number {
    id = "4.4.eyes_retina_median",
    what = "eyes off by table 5.1, retina alone: median",
    where = "goal",
    ours = statistics.median(medians.retina),
    unit = "m",
    at_most = 300 * um,
    reason = "this project's goal",
  }
  book:number {
    id = "4.4.eyes_retina_90",
    what = "the same, 90th percentile",
    where = "goal",
    ours = statistics.percentile(medians.retina, 0.9),
    unit = "m",
  }
  book:number {
    id = "4.4.eyes_full_median",
    what = "eyes off by table 5.1, axis and retinal shape: median",
    where = "goal",
    ours = statistics.median(medians.full),
    unit = "m",
    at_most = 150 * um,
    reason = "this project's goal",
  }
  book:number {
    id = "4.4.eyes_full_90",
    what = "the same, 90th percentile",
    where = "goal",
    ours = statistics.percentile(medians.full, 0.9),
    unit = "m",
  }
end

return by_focus
