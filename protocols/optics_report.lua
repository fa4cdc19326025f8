-- Optical properties of an eye and the lenses before it: first order, aberrations, wide-angle maps (thesis 3 and 4.1).
-- SPDX-License-Identifier: Apache-2.0
local optics = require "optics"
local units = require "units"
local mm, um, deg = units.mm, units.um, units.deg

-- `count` values from `first` to `last`.
local function range(first, last, count)
  local values = {}
  for i = 1, count do
    values[i] = first + (last - first) * (i - 1) / (count - 1)
  end
  return values
end

-- One field of all tables of a list, as a series; a line breaks where there is none.
local function series(label, x, list, field, mark)
  local y = {}
  for i = 1, #x do
    y[i] = list[i] and list[i][field] or 0 / 0
  end
  return { label = label, x = x, y = y, mark = mark }
end

local function in_mm(value) return value and ("%.5f"):format(value / mm) or "–" end

-- Some calculations are of centered, homogeneous systems only: what refuses is left out, and the report says why.
local function attempt(run, what, f, ...)
  local done, found = pcall(f, ...)
  if done then return found end
  run:note(what .. ": " .. tostring(found))
end

local function first_order(run, eye, p)
  local image = eye:axial_image() or error("the retina's image is at infinity: there is no aerial image to report on")
  local viewing = attempt(run, "aperture and depth of focus", eye.viewing, eye, { confusion = p.confusion })
  local focus = viewing and viewing.depth_of_focus
  run:result("magnification", image.magnification)
  if viewing then run:result("numerical_aperture", viewing.numerical_aperture.oslo) end
  run:result("retina_image_distance", image.distance, "m")
  if focus then run:result("depth_of_focus", focus.thesis, "m") end
  local points, rows = eye:first_order() or {}, {}
  for _, name in ipairs {
    "focal_length",
    "front_focal_length",
    "back_focal_length",
    "first_principal_point",
    "second_principal_point",
    "front_focus",
    "back_focus",
    "first_nodal_point",
    "second_nodal_point",
  } do
    rows[#rows + 1] = { (name:gsub("_", " ")), in_mm(points[name]) }
  end
  rows[#rows + 1] = { "image of the retina, from the last vertex", in_mm(image.distance) }
  for _, side in ipairs(focus and { "thesis", "image_side", "object_side" } or {}) do
    rows[#rows + 1] = { "depth of focus (4.1), " .. side:gsub("_", " "), in_mm(focus[side]) }
  end
  run:table { title = "First order: " .. eye:info().title, header = { "", "mm" }, rows = rows }
end

local function seidel(run, eye)
  local sums, rows = attempt(run, "third-order aberrations", eye.seidel, eye), {}
  if not sums then return end
  local names = { "spherical", "coma", "astigmatism", "petzval", "distortion" }
  local function add(label, from)
    local row = { label }
    for _, name in ipairs(names) do
      row[#row + 1] = ("%.2f"):format(from[name] / um)
    end
    rows[#rows + 1] = row
  end
  for _, surface in ipairs(sums.surfaces) do
    add("surface " .. surface.surface, surface)
  end
  add("all", sums.total)
  run:table {
    title = "Seidel sums, µm, of a flat object 5 mm high on the retina",
    header = { "", table.unpack(names) },
    rows = rows,
  }
end

local function on_axis(run, eye, p)
  local depths, paraxial, traced = range(0, p.depth, 33), {}, {}
  for i, depth in ipairs(depths) do
    paraxial[i], traced[i] = eye:axial_image(depth) or {}, eye:spot { depth = depth } or {}
  end
  run:plot {
    title = "Image of an object on the axis",
    x = { "object before the retina", "mm" },
    y = { "image behind the last vertex", "mm" },
    series = {
      series("first order", depths, paraxial, "distance"),
      series("least spot", depths, traced, "best_focus", "dashed"),
    },
  }
end

local function fields(run, eye, p)
  local angles = range(0, p.field, 31)
  local curvature = eye:field_curvature(angles)
  local retina, span = curvature.points, curvature.span
  run:result("field_curvature_span", span, "m")
  run:plot {
    title = "Field curvature",
    x = { "field angle", "deg" },
    y = { "image of the retina", "mm" },
    series = {
      series("least spot", angles, retina, "best_focus"),
      series("tangential", angles, retina, "tangential", "dashed"),
      series("sagittal", angles, retina, "sagittal", "dashed"),
    },
  }
  run:plot {
    title = "Distortion",
    x = { "field angle", "deg" },
    y = { "relative to first order", "" },
    series = { series("retina", angles, retina, "distortion") },
  }
  local spots = {}
  for i, depth in ipairs(range(0, p.depth, 3)) do
    spots[i] =
      series(format_quantity(depth, "m") .. " before the retina", angles, eye:field_curvature(angles, depth).points, "rms")
  end
  run:plot {
    title = "Spot size at best focus",
    x = { "field angle", "deg" },
    y = { "rms radius", "um" },
    series = spots,
  }
end

local function spot_diagrams(run, eye, p)
  local spots = {}
  for _, angle in ipairs(range(0, p.field, 3)) do
    local spot = eye:spot { angle = angle }
    if spot then
      local x, y, mean = {}, {}, 0
      for i = 1, #spot.x do
        mean = mean + spot.x[i] / #spot.x
      end
      for i = 1, #spot.x do
        x[i], y[i] = spot.x[i] - mean, spot.y[i]
      end
      spots[#spots + 1] = { label = ("%.0f°"):format(angle / deg), x = x, y = y, mark = "points" }
    end
  end
  run:plot {
    title = "Spots of the retina, each at its best focus",
    equal_aspect = true,
    x = { "in the plane of axis and field", "um" },
    y = { "across", "um" },
    series = spots,
  }
end

local function modulation(run, eye, p)
  local per_mm, all = range(0, 50, 26), {}
  for _, angle in ipairs(range(0, p.field, 3)) do
    local spots = {}
    for i, frequency in ipairs(per_mm) do
      spots[i] = eye:spot { angle = angle, frequency = frequency / mm }
    end
    local label = ("%.0f°"):format(angle / deg)
    all[#all + 1] = series(label .. " tangential", per_mm, spots, "mtf_tangential")
    if angle > 0 then all[#all + 1] = series(label .. " sagittal", per_mm, spots, "mtf_sagittal", "dashed") end
  end
  run:plot {
    title = "Modulation of the retina's image, geometric",
    x = { "line pairs per mm of the image", "" },
    y = { "contrast", "" },
    series = all,
  }
end

-- All curves as one series: a NaN lifts the pen.
local function curves(label, values, draw, mark)
  local all = { label = label, mark = mark, x = {}, y = {} }
  for _, value in ipairs(values) do
    local curve = draw(value)
    for i = 1, #curve.r do
      all.x[#all.x + 1], all.y[#all.y + 1] = curve.z[i], curve.r[i]
    end
    all.x[#all.x + 1], all.y[#all.y + 1] = 0 / 0, 0 / 0
  end
  return all
end

-- Traced image, then the map's inverse: how far from where it started? Just inside the map: on its rim the table's own
-- nanometers decide whether a point is outside.
local function round_trip(eye, map, p)
  local worst, count, inside = 0, 0, 1 * um
  for _, angle in ipairs(range(0, math.min(p.field, 0.999 * map:info().max_angle), 25)) do
    for _, depth in ipairs(range(inside, p.depth - inside, 17)) do
      local point = eye:point_at_field(angle, depth)
      local image = point and map:image(point) and map:image(point, { traced = true }) -- nil where the map says nothing
      local back = image and map:locate(image)
      if back then
        worst, count = math.max(worst, (back.position - point):norm()), count + 1
      end
    end
  end
  return worst, count, 25 * 17
end

local function wide_angle(run, eye, p)
  local made, map = pcall(eye.wide_angle_map, eye, { max_angle = math.max(p.field, 35 * deg), max_depth = p.depth })
  if not made then return run:note("no wide-angle map: " .. tostring(map)) end
  local worst, count, tried = round_trip(eye, map, p)
  if count > 0 then run:result("map_round_trip_max", worst, "m") end
  local limit = map:info().max_angle
  run:note(
    ("the map reaches %.1f°; %d of %d points went there and back, the worst came back %.3f µm off"):format(
      limit / deg,
      count,
      tried,
      worst / um
    )
  )
  local near = map:image(eye:point_at_field(0, 0)) or vector(0, 0, 0)
  local far = map:image(eye:point_at_field(0, p.depth)) or near
  local edge = map:image(eye:point_at_field(0.98 * limit, 0)) or near
  run:plot {
    title = "Isofocus surfaces and isopixel curves",
    equal_aspect = true,
    x = { "z, from the retina", "mm" },
    y = { "from the axis", "mm" },
    series = {
      curves("isofocus", range(near.z, far.z, 9), function(focus) return map:isofocus(focus) end),
      curves("isopixel", range(0, math.abs(edge.x), 11), function(height) return map:isopixel(height) end, "dashed"),
    },
    note = ("in focus at d_ls = %.2f to %.2f mm; imaged at |d_op| = 0 to %.2f mm"):format(
      near.z / mm,
      far.z / mm,
      math.abs(edge.x) / mm
    ),
  }
end

-- What the eye's uncertain parameters cost depth from focus (table 5.1, figures 4.2 and 4.5).
local function tolerance(run, eye)
  local function analyzed(calibrated)
    local analysis = eye:error_analysis { method = "one_at_a_time", calibrated = calibrated }
    return analysis.parameters
  end
  local before, after, rows = analyzed(false), {}, {}
  if #before == 0 then return run:note "none of the parameters of table 5.1 is in this system" end
  for _, one in ipairs(analyzed(true)) do
    after[one.parameter] = one
  end
  local function worst(one) return one.minus and one.plus and ("%.3f"):format(math.max(one.minus, one.plus) / mm) or "–" end
  for _, one in ipairs(before) do
    rows[#rows + 1] = { one.parameter, worst(one), worst(after[one.parameter]) }
  end
  run:table {
    title = "Largest error of depth from focus on the axis, mm, one parameter off by one sigma",
    header = { "parameter", "as prescribed", "calibrated on the retina" },
    rows = rows,
  }
end

-- One sigma of the depth that the localizer finds, for a robot of 2 mm by 1 mm and 0.2 px of tracker noise.
local function localization(run, eye, p)
  local near = eye:axial_image()
  local far = eye:axial_image(p.depth)
  local focus = near and far and (near.distance + far.distance) / 2
  local made, view = pcall(eye.localizer, eye, { microscope = { focus = focus }, max_m = 7 * mm })
  if not made then return run:note("no localizer: " .. tostring(view)) end
  local robot, all = { shape = "spheroid", half_length = 1 * mm, radius = 0.5 * mm }, {}
  for _, one in ipairs { { "robot across the axis", { 1, 0, 0 } }, { "robot along the axis", { 0, 0, 1 } } } do
    local name, axis = table.unpack(one)
    local depths, sigmas, seen_any = range(1 * mm, p.depth, 15), {}, false
    for i, depth in ipairs(depths) do
      local seen = view:ellipse { body = robot, position = { 0, 0, depth }, axis = axis }
      local pose = seen and view:locate { body = robot, ellipse = seen, position = { 0, 0, depth }, axis = axis }
      sigmas[i] = pose and pose.status == "found" and pose.sigma[3] or 0 / 0
      seen_any = seen_any or sigmas[i] == sigmas[i]
    end
    if seen_any then all[#all + 1] = { label = name, x = depths, y = sigmas } end
  end
  if #all == 0 then return run:note "no robot of 2 mm by 1 mm is seen here" end
  run:plot {
    title = "Depth by pose: one sigma for 0.2 px of noise",
    x = { "robot before the retina", "mm" },
    y = { "sigma of depth", "um" },
    series = all,
  }
end

return {
  title = "Optics report",
  parameters = {
    prescription = { choices = optics.prescriptions(), default = "navarro_condensing", help = "eye and lenses" },
    confusion = { unit = "um", default = 6.4 * um, min = 0.1 * um, max = 1 * mm, help = "circle of confusion" },
    field = { unit = "deg", default = 30 * deg, min = 1 * deg, max = 45 * deg, help = "half field, at the pupil's center" },
    depth = { unit = "mm", default = 8 * mm, min = 1 * mm, max = 12 * mm, help = "deepest object before the retina" },
  },
  run = function(_, p, run)
    local eye = optics.system { name = p.prescription }
    run:picture { title = "Layout", svg = eye:layout { angles = range(0, p.field, 3) } }
    first_order(run, eye, p)
    seidel(run, eye)
    run:progress(0.1, "tracing")
    on_axis(run, eye, p)
    fields(run, eye, p)
    spot_diagrams(run, eye, p)
    modulation(run, eye, p)
    run:progress(0.4, "the wide-angle map")
    wide_angle(run, eye, p)
    run:progress(0.7, "tolerance")
    tolerance(run, eye)
    run:progress(0.9, "localization")
    localization(run, eye, p)
  end,
}
