-- Biometric calibration of depth by focus on the retina alone (thesis 4.3): the in-focus position of the sensor for a target
-- on the retina, and the retinal depth, correct the law (4.10) to (4.12); beside it the law as prescribed and the one through
-- all points of an axis (4.4.4). Before and after, as figures 4.5, 4.6 and 4.10.
-- SPDX-License-Identifier: Apache-2.0
local expect = require "analysis.expectations"
local eyes = require "session.eyes"
local focusing = require "calibration.focus"
local optics = require "optics"
local published = require "analysis.published"
local statistics = require "analysis.statistics"
local targets = require "session.targets"
local units = require "units"
local mm, um = units.mm, units.um

-- d_ls where a target on the axis, `depth` before the retina, is sharp.
local function sharp_at(rig, law, depth, p)
  targets.put(rig, vector(0, 0, depth))
  local model = rig:model()
  local told = focusing.autofocus(rig, {
    near = law:distance(depth),
    reach = p.reach,
    step = 20 * um,
    window = { u = model.center_px[1], v = model.center_px[2], size = 120 },
  })
  if told.answer ~= "found" then
    error(("the target %s before the retina was not found sharp: %s"):format(format_quantity(depth, "m"), told.answer), 0)
  end
  return told.position, told.sigma
end

-- Largest error of a law's depths; a depth that it puts outside of the vitreous counts as one at its end.
local function worst(law, points, vitreous)
  local most = 0
  for _, point in ipairs(points) do
    local depth = law:depth(point.distance)
    if not depth then depth = point.distance < law:distance(0) and 0 or vitreous end
    most = math.max(most, math.abs(depth - point.depth))
  end
  return most
end

local function plot(run, laws, points)
  local measured = { label = "measured", x = {}, y = {}, mark = "points" }
  for i, point in ipairs(points) do
    measured.x[i], measured.y[i] = point.distance, point.depth
  end
  local at, all, errors = statistics.range(measured.x[1], measured.x[#points], 41), { measured }, {}
  for _, one in ipairs(laws) do
    local y, off = {}, {}
    for i, distance in ipairs(at) do
      y[i] = one.law:depth(distance) or 0 / 0
    end
    for i, point in ipairs(points) do
      off[i] = (one.law:depth(point.distance) or 0 / 0) - point.depth
    end
    all[#all + 1] = { label = one.name, x = at, y = y, mark = one.mark }
    errors[#errors + 1] = { label = one.name, x = measured.y, y = off, mark = one.mark }
  end
  run:plot {
    title = "Depth against the sensor's place, as figure 4.10",
    x = { "d_ls", "mm" },
    y = { "before the retina", "mm" },
    series = all,
  }
  run:plot {
    title = "Error of depth, as figures 4.5 and 4.6",
    x = { "before the retina", "mm" },
    y = { "error", "mm" },
    series = errors,
  }
end

-- Figures 4.5 and 4.6 by computation: one parameter off, before and after.
local function computed(book)
  local eye = optics.system { name = "navarro_condensing" }
  for _, part in ipairs { 0.97, 1.03 } do
    local off = eye:with { ["lens.index"] = part * eye:info().parameters["lens.index"] }
    local before, after = eye:localization_error { truth = off }, eye:localization_error { truth = off, calibrated = true }
    local sign = part < 1 and "minus" or "plus"
    book:number {
      id = "4.5." .. sign .. "_before",
      what = ("index of the lens %+.0f %%, uncalibrated, largest error"):format(100 * (part - 1)),
      where = "figure 4.5",
      ours = before,
      unit = "m",
      at_least = 1 * mm,
      printed = true,
      reason = '4.3: "original error values were on the order of 1 mm"',
    }
    book:number {
      id = "4.5." .. sign .. "_after",
      what = ("index of the lens %+.0f %%, calibrated, largest error"):format(100 * (part - 1)),
      where = "figure 4.5",
      ours = after,
      unit = "m",
      at_most = 0.15 * before,
      reason = '"greatly reduce them": to a seventh or better',
      why = "by the shift of the sensor alone, which leaves least; the thesis leaves one equation for two unknowns",
    }
  end
end

return {
  title = "Biometric calibration",
  needs = { "top_camera", "stage", "sample" },
  rig = "bare_sensor",
  parameters = {
    eye = eyes.parameter "perturbed",
    draw = eyes.draw,
    points = { default = 6, min = 3, max = 50, integer = true, help = "targets on the axis" },
    deepest = { unit = "mm", default = 6 * mm, min = 1 * mm, max = 8 * mm, help = "of them, before the retina" },
    reach = { unit = "mm", default = 3 * mm, min = 0.5 * mm, max = 8 * mm, help = "of each search, either way" },
  },
  run = function(rig, p, run)
    local eye = rig:eye()
    local truth = eyes.set(rig, run, p.eye, p.draw)
    run:defer(function() targets.remove(rig) end)
    local believed = eye:axis_law()
    local points = {}
    for i, depth in ipairs(statistics.range(0.05 * mm, p.deepest, p.points)) do
      run:progress((i - 1) / p.points, ("target %d of %d"):format(i, p.points))
      run:checkpoint("before target " .. i)
      local distance, sigma = sharp_at(rig, believed, depth, p)
      points[i] = { depth = depth, distance = distance }
      run:record("focus", { depth = depth, distance = distance, sigma = sigma }, {
        depth = "m",
        distance = "m",
        sigma = "m",
      }, {
        depth = "of the target before the retina",
        distance = "of the condensing lens at which the target is sharpest",
        sigma = "standard deviation of the distance",
      })
    end
    -- On the retina: the target lies 0.05 mm before it, which the law is told.
    local retina = believed:distance(0) + points[1].distance - believed:distance(points[1].depth)
    local laws = {
      { name = "as prescribed", law = believed, mark = "dashed" },
      { name = "biometric: the retina alone", law = believed:calibrate({ retina = retina }).law },
      {
        name = "biometric, minimum norm",
        law = believed:calibrate({ retina = retina, method = "minimum_norm" }).law,
        mark = "dashed",
      },
      { name = "all points (4.4.4)", law = believed:calibrate({ points = points }).law },
    }
    plot(run, laws, points)
    local rows, found = {}, {}
    for i, one in ipairs(laws) do
      found[i] = worst(one.law, points, rig:model().lens_depth)
      rows[i] = { one.name, format_quantity(found[i], "m") }
    end
    run:table { title = "Largest error of depth over the points", header = { "law", "error" }, rows = rows }
    eyes.report(run, eye, truth)
    run:result("calibrated_error", found[2], "m")
    local book = expect.book(run, "4.4.4")
    book:number {
      id = "4.10.biometric",
      what = "largest error on the axis after calibration on the retina alone",
      where = "figure 4.10",
      ours = found[2],
      unit = "m",
      at_most = published.chapter_4.model_eye.depth_of_field,
      reason = "the depth of field of 4.4.3",
      why = ("uncalibrated %s on this eye; with all points %s"):format(
        format_quantity(found[1], "m"),
        format_quantity(found[4], "m")
      ),
    }
    book:number {
      id = "4.10.full",
      what = "largest error with all points",
      where = "figure 4.10",
      ours = found[4],
      unit = "m",
      at_most = found[2],
      reason = "more points are not to be worse",
    }
    computed(book)
    book:close()
  end,
}
