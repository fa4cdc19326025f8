-- Localization errors by an uncertain eye, and their reduction by calibration, estimation and another lens (thesis 3.2, 4.2 to
-- 4.4, 5.3, 5.4).
-- SPDX-License-Identifier: Apache-2.0
local bars = require "plotting.bar_charts"
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

-- What a system cannot answer (no stop, no cornea, no scale that explains its retina) is said in the report, and the
-- rest goes on.
local function attempt(run, what, f, ...)
  local results = table.pack(pcall(f, ...))
  if results[1] then return table.unpack(results, 2, results.n) end
  run:note(("no %s: %s"):format(what, tostring(results[2])))
end

-- The worse of both signs, or of the one that has an answer.
local function worst_of(one)
  if not (one and (one.minus or one.plus)) then return false end
  return math.max(one.minus or one.plus, one.plus or one.minus)
end

local function bar_chart(run, title, options)
  options.title = title
  run:picture { title = title, svg = bars.svg(options) }
end

-- Figures 4.2, 4.5 and table 5.2: by each method, as the eye is believed, and calibrated on its retina.
local methods = {
  { name = "axis", title = "Depth by focus on the axis, largest error" },
  { name = "field", title = "Place by focus over the field, largest error" },
  { name = "pose", title = "Place by pose over the field, mean error" },
}

-- Error analysis by one of the methods of localization; the axis has no field.
local function analyzed(eye, method, p, options)
  options.error, options.depth_to = method.name, p.depth
  if method.name ~= "axis" then options.max_angle = p.field end
  return eye:error_analysis(options)
end

local function sensitivity(run, eye, p)
  for _, method in ipairs(methods) do
    local function of(calibrated)
      return analyzed(eye, method, p, { method = "one_at_a_time", calibrated = calibrated }).parameters
    end
    local before = attempt(run, "sensitivity by " .. method.name, of, false)
    local after, rows = {}, {}
    for _, one in ipairs(before and attempt(run, "calibrated sensitivity by " .. method.name, of, true) or {}) do
      after[one.parameter] = one
    end
    for i, one in ipairs(before or {}) do
      rows[i] = { name = one.parameter, values = { worst_of(one), worst_of(after[one.parameter]) } }
    end
    if #rows > 0 then
      table.sort(rows, function(a, b) return (a.values[1] or -1) > (b.values[1] or -1) end)
      if rows[1].values[1] then run:result("worst_error_" .. method.name, rows[1].values[1], "m") end
      bar_chart(run, method.title .. ", one parameter off by one sigma", {
        rows = rows,
        labels = { "as prescribed", "calibrated on the retina" },
        unit = "mm",
        divisor = mm,
      })
    end
  end
end

local function monte_carlo(run, eye, p)
  local rows = {}
  local function in_mm(value) return ("%.3f"):format(value / mm) end
  for _, method in ipairs(methods) do
    for _, how in ipairs {
      { "as prescribed", false, 0 },
      { "calibrated", true, 0 },
      { "calibrated, retina ±0.3 mm", true, 0.3 * mm },
    } do
      local found = attempt(
        run,
        "Monte Carlo by " .. method.name,
        analyzed,
        eye,
        method,
        p,
        { method = "monte_carlo", calibrated = how[2], retinal_depth_error = how[3], count = p.eyes }
      )
      if found then
        rows[#rows + 1] = {
          method.name .. ", " .. how[1],
          in_mm(found.median),
          in_mm(found.rms),
          in_mm(found.percentile_95),
          in_mm(found.max),
          found.failed,
        }
      end
    end
  end
  if #rows > 0 then
    run:table {
      title = ("All of table 5.1 at once, %d eyes: error, mm"):format(p.eyes),
      header = { "", "median", "rms", "95 %", "largest", "without an answer" },
      rows = rows,
    }
  end
end

local function variance_attribution(run, eye, p)
  local function of(calibrated)
    local options = { method = "variance_attribution", count = p.eyes, depth_to = p.depth, calibrated = calibrated }
    return eye:error_analysis(options).parameters
  end
  local before = attempt(run, "worth of measurements", of, false)
  if not before or #before == 0 then return end
  local after, rows = {}, {}
  for _, one in ipairs(of(true)) do
    after[one.parameter] = one.reduction
  end
  for i, one in ipairs(before) do
    rows[i] = { name = one.parameter, values = { math.max(one.reduction, 0), math.max(after[one.parameter] or 0, 0) } }
  end
  bar_chart(
    run,
    "Which measurement of the patient helps depth by focus",
    { rows = rows, labels = { "as prescribed", "calibrated on the retina" }, unit = "% less rms error", divisor = 0.01 }
  )
end

-- The parameter that costs most is off by one sigma; (4.10) to (4.12) calibrated in the three ways.
local function calibration(run, eye, p)
  local worst = eye:axial_image() and eye:error_analysis({ method = "one_at_a_time", depth_to = p.depth }).parameters[1]
  if not worst then return run:note "no image, or none of the parameters of table 5.1 in this system: nothing to calibrate" end
  local nominal = eye:info().parameters[worst.parameter]
  local true_eye = attempt(run, "eye that differs", eye.with, eye, { [worst.parameter] = 1.02 * nominal })
  local depths, sharp, points = range(0, p.depth, 17), {}, {}
  for i, depth in ipairs(depths) do
    local image = true_eye and true_eye:axial_image(depth)
    if not image then return run:note "an object's image lies at infinity: nothing to calibrate on the axis" end
    sharp[i] = image.distance
    if i % 4 == 1 then points[#points + 1] = { depth = depth, distance = image.distance } end
  end
  local law = eye:axis_law()
  local laws = {
    { "as prescribed", law },
    { "on the retina, sensor shifted", law:calibrate({ retina = sharp[1] }).law },
    { "on the retina, minimum norm", law:calibrate({ retina = sharp[1], method = "minimum_norm" }).law },
    { "at five depths (4.4.4)", law:calibrate({ points = points }).law },
  }
  local series = {}
  for k, one in ipairs(laws) do
    local errors = {}
    for i, depth in ipairs(depths) do
      local found = one[2]:depth(sharp[i])
      errors[i] = found and found - depth or 0 / 0
    end
    series[k] = { label = one[1], x = depths, y = errors, mark = k == 1 and "dashed" or "line" }
  end
  run:plot {
    title = ("Calibration on the axis: %s is 2 %% more"):format(worst.parameter),
    x = { "object before the retina", "mm" },
    y = { "error of depth by focus", "mm" },
    series = series,
  }
  if math.max(math.abs(eye:axial_image().distance), math.abs(sharp[1])) > 1 then
    return run:note "the retina's image is too far away to tell of the eye"
  end
  local estimate = attempt(run, "estimate of the eye", eye.estimate, eye, { foci = points })
  local rows = {}
  for i, one in ipairs(estimate and estimate.parameters or {}) do
    rows[i] = { name = one.parameter, values = { one.learned, one.sigma / one.prior_sigma } }
  end
  table.sort(rows, function(a, b) return a.values[1] > b.values[1] end)
  if #rows > 0 then
    bar_chart(run, "What five foci on the axis, of 20 µm, tell of the eye", {
      rows = rows,
      labels = {
        "part of the doubt that is resolved",
        "sigma afterwards over sigma before",
      },
    })
  end
end

-- The ellipse of one sigma in a plane through the axis, `times` as large; a NaN lifts the pen after it.
local function add_ellipse(curve, at, c, times)
  -- Cholesky: x = l11 cos, z = l21 cos + l22 sin
  local l11 = math.sqrt(math.max(c[1][1], 0))
  local l21 = l11 > 0 and c[3][1] / l11 or 0
  local l22 = math.sqrt(math.max(c[3][3] - l21 * l21, 0))
  for _, t in ipairs(range(0, 2 * math.pi, 37)) do
    curve.x[#curve.x + 1] = at.z + times * (l21 * math.cos(t) + l22 * math.sin(t))
    curve.y[#curve.y + 1] = at.x + times * l11 * math.cos(t)
  end
  curve.x[#curve.x + 1], curve.y[#curve.y + 1] = 0 / 0, 0 / 0
end

local function by_pose(run, eye, p, each_place)
  local near, far = eye:axial_image(), eye:axial_image(p.depth)
  if not (near and far) then return run:note "the image lies at infinity: nothing to localize by" end
  local view =
    attempt(run, "localizer", eye.localizer, eye, { microscope = { focus = (near.distance + far.distance) / 2 }, max_m = 7 * mm })
  if not view then return end
  local robot, curve = { shape = "spheroid", half_length = 1 * mm, radius = 0.5 * mm }, { label = "by pose", x = {}, y = {} }
  each_place(function(place)
    local seen = view:ellipse { body = robot, position = place, axis = { 0, 1, 0 } }
    local pose = seen and view:locate { body = robot, ellipse = seen, position = place, axis = { 0, 1, 0 } }
    if pose and pose.status == "found" then add_ellipse(curve, place, pose.candidates[1].covariance, p.magnified) end
  end)
  return curve
end

local function by_focus(run, eye, p, each_place)
  local map = attempt(run, "wide-angle map", eye.wide_angle_map, eye, { max_depth = p.depth })
  if not map then return end
  local curve = { label = "by focus", x = {}, y = {}, mark = "dashed" }
  each_place(function(place)
    local image = map:image(place)
    local found = image and map:locate(image, { image_sigma = 3 * um, focus_sigma = 50 * um })
    if found then add_ellipse(curve, place, found.covariance, p.magnified) end
  end)
  return curve
end

local function localization(run, eye, p)
  local function each_place(f)
    for _, angle in ipairs(range(0, 5 / 6 * p.field, 4)) do
      for _, depth in ipairs(range(1 * mm, p.depth - 0.5 * mm, 4)) do
        local place = eye:point_at_field(angle, depth)
        if place then f(place) end
      end
    end
  end
  local series = {}
  for _, curve in pairs { by_pose(run, eye, p, each_place) or nil, by_focus(run, eye, p, each_place) or nil } do
    if #curve.x > 0 then series[#series + 1] = curve end
  end
  if #series == 0 then return end
  run:plot {
    title = ("Where it is, one sigma, %g times as large"):format(p.magnified),
    equal_aspect = true,
    x = { "z, from the retina", "mm" },
    y = { "from the axis", "mm" },
    series = series,
    note = "by pose: a robot of 2 mm by 1 mm across the plane, 0.2 px of noise; by focus: 3 µm in the image, 50 µm of focus",
  }
end

local function design(run, eye, p)
  local variables, parameters = {}, eye:info().parameters
  for _, one in ipairs { "conic", "a4", "a6", "a8", "a10" } do
    local name = "condensing.anterior." .. one
    if parameters[name] then variables[#variables + 1] = name end
  end
  if #variables < 2 then return run:note "no aspheric condensing lens in this system: no lens is designed" end
  local told = attempt(run, "lens design", eye.optimize, eye, { variables = variables })
  if not told then return end
  run:note(
    ("lens design: %s%s, span of best focus %s, before %s"):format(
      told.status,
      told.reason == "" and "" or " (" .. told.reason .. ")",
      format_quantity(told.after.span, "m"),
      format_quantity(told.before.span, "m")
    )
  )
  run:result("design_span_before", told.before.span, "m")
  run:result("design_span_after", told.after.span, "m")
  local angles, series = range(0, p.field, 31), {}
  for k, one in ipairs { { "as prescribed", eye }, { "designed", told.system } } do
    local y = {}
    for i, point in ipairs(one[2]:field_curvature(angles).points) do
      y[i] = point.best_focus or 0 / 0
    end
    series[k] = { label = one[1], x = angles, y = y, mark = k == 1 and "dashed" or "line" }
  end
  run:plot {
    title = "Lens design: the image of the retina",
    x = { "field angle", "deg" },
    y = { "best focus behind the last vertex", "mm" },
    series = series,
    note = "variables: " .. table.concat(variables, ", "),
  }
end

return {
  title = "Optics under uncertainty",
  parameters = {
    prescription = { choices = optics.prescriptions(), default = "navarro_condensing", help = "eye and lenses" },
    eyes = { default = 60, min = 2, max = 10000, integer = true, help = "drawn by chance" },
    field = { unit = "deg", default = 30 * deg, min = 1 * deg, max = 45 * deg, help = "half field, at the pupil's center" },
    depth = { unit = "mm", default = 8 * mm, min = 2 * mm, max = 12 * mm, help = "deepest object before the retina" },
    magnified = { default = 12, min = 1, max = 1000, help = "how much the plotted ellipses are" },
  },
  run = function(_, p, run)
    local eye = optics.system { name = p.prescription }
    sensitivity(run, eye, p)
    run:progress(0.3, "Monte Carlo")
    monte_carlo(run, eye, p)
    run:progress(0.6, "what to measure")
    variance_attribution(run, eye, p)
    run:progress(0.7, "calibration")
    calibration(run, eye, p)
    run:progress(0.8, "localization")
    localization(run, eye, p)
    run:progress(0.9, "lens design")
    design(run, eye, p)
  end,
}
