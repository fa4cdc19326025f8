-- The wide-angle image formation of an eye and its lens: isofocus surfaces, isopixel curves, and the thesis' cubics for them
-- with their residuals (thesis 3.2, 4.4.2, 5.2; figures 3.5, 3.6, 4.8, 4.9, 5.1b, 5.3).
-- SPDX-License-Identifier: Apache-2.0
local curves = require "plotting.curves"
local expect = require "analysis.expectations"
local optics = require "optics"
local published = require "analysis.published"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, um, deg = units.mm, units.um, units.deg

-- Which system stands for which figures.
local systems = {
  {
    key = "3",
    name = "navarro_condensing",
    picture = "figure 3.5",
    fits = "figure 3.6",
    step = published.figure_3_5.sensor_step,
  },
  {
    key = "4",
    name = "model_eye_in_air",
    picture = "figure 4.8",
    fits = "figure 4.9",
    step = published.figure_4_8.sensor_step,
    why = "the lens of chapter 4's eye is not disclosed: a stand-in with its magnification and depth of focus",
  },
  { key = "5", name = "model_eye_5_3", picture = "figure 5.1b", fits = "figure 5.3" },
}

local function picture(run, map, one, near, far, edge)
  local focuses = {}
  if one.step then
    for focus = near, far, one.step do
      focuses[#focuses + 1] = focus
    end
  else
    focuses = statistics.range(near, far, 9)
  end
  run:plot {
    title = ("Isofocus surfaces and isopixel curves, %s, as %s"):format(one.name, one.picture),
    equal_aspect = true,
    x = { "z, from the retina", "mm" },
    y = { "from the axis", "mm" },
    series = {
      curves.family("isofocus", focuses, function(focus) return map:isofocus(focus) end),
      curves.family("isopixel", statistics.range(0, edge, 11), function(height) return map:isopixel(height) end, "dashed"),
    },
    note = one.step and ("steps of the sensor: %s"):format(format_quantity(one.step, "m")) or nil,
  }
  return #focuses
end

-- A fitted parameter, its points and its cubic; returns the residuals, and whether it is one-to-one (4.1).
local function fit_plot(run, one, name, list, at, cubic, x_title, unit)
  local x, y, fitted, residual = curves.field(list, at), curves.field(list, name), {}, {}
  local rising, falling = true, true
  for i = 1, #x do
    fitted[i] = curves.cubic(cubic, x[i])
    residual[i] = y[i] - fitted[i]
    if i > 1 then
      rising, falling = rising and y[i] > y[i - 1], falling and y[i] < y[i - 1]
    end
  end
  run:plot {
    title = ("%s: %s and its cubic, as %s"):format(one.name, name, one.fits),
    x = { x_title, "mm" },
    y = { name, unit },
    series = {
      { label = "traced", x = x, y = y, mark = "points" },
      { label = "cubic", x = x, y = fitted, mark = "dashed" },
    },
  }
  run:plot {
    title = ("%s: what the cubic of %s leaves"):format(one.name, name),
    x = { x_title, "mm" },
    y = { "residual", unit == "mm" and "um" or "" },
    series = { { label = "residual", x = x, y = residual } },
  }
  return residual, rising or falling
end

-- The thesis' localization back through its fitted curves: isopixel line meets isofocus circle.
local function fits(run, one, map, book)
  local made = map:thesis_curves()
  local rows, all_monotone = {}, true
  for _, fit in ipairs {
    { "radius", made.surfaces, "focus", made.radius, "d_ls", "mm" },
    { "pole", made.surfaces, "focus", made.pole, "d_ls", "mm" },
    { "slope", made.curves, "height", made.slope, "d_op", "" },
    { "intercept", made.curves, "height", made.intercept, "d_op", "mm" },
  } do
    local name, list, at, cubic, axis, unit = table.unpack(fit)
    local residual, monotone = fit_plot(run, one, name, list, at, cubic, axis, unit)
    local largest = statistics.max(statistics.map(residual, math.abs))
    rows[#rows + 1] =
      { name, unit == "mm" and format_quantity(largest, "m") or ("%.3g"):format(largest), monotone and "yes" or "no" }
    if name == "pole" or name == "slope" then all_monotone = all_monotone and monotone end
  end
  run:table {
    title = one.name .. ": what the cubics leave",
    header = { "parameter of the fit", "largest residual", "one-to-one" },
    rows = rows,
  }
  book:number {
    id = one.key .. ".one_to_one",
    what = one.name .. ": poles and slopes are one-to-one",
    where = one.fits,
    thesis = 1,
    ours = all_monotone and 1 or 0,
    within = 0,
    reason = "4.1: localization without ambiguity asks for it",
    why = one.why,
  }
  local bent = statistics.max(curves.field(made.curves, "max_residual"))
  book:number {
    id = one.key .. ".isopixel_straight",
    what = one.name .. ": isopixel curves are lines, largest bend",
    where = one.fits,
    ours = bent,
    unit = "m",
    at_most = 50 * um,
    reason = '"the isopixel curves are lines": below the 150 um of depth of field',
    why = one.why,
  }
  return made
end

return {
  title = "Isofocus surfaces and isopixel curves",
  parameters = {
    system = {
      choices = { "all", "navarro_condensing", "model_eye_in_air", "model_eye_5_3" },
      default = "all",
      help = "eye and lens",
    },
    depth = { unit = "mm", default = 8 * mm, min = 1 * mm, max = 12 * mm, help = "deepest object before the retina" },
    field = { unit = "deg", default = 35 * deg, min = 5 * deg, max = 45 * deg, help = "half field, at the pupil's center" },
  },
  run = function(_, p, run)
    local book = expect.book(run, "3.2")
    for one in run:each(systems, "system") do
      if p.system == "all" or p.system == one.name then
        local eye = optics.system { name = one.name }
        local map = eye:wide_angle_map { max_angle = p.field, max_depth = p.depth }
        local limit = map:info().max_angle
        local near = map:image(eye:point_at_field(0, 0)).z
        local far = map:image(eye:point_at_field(0, 0.999 * p.depth)).z
        local edge = math.abs(map:image(eye:point_at_field(0.98 * limit, 0)).x)
        picture(run, map, one, near, far, edge)
        run:note(
          ("%s: the map reaches %s; in focus from %s to %s, imaged to %s from the axis"):format(
            one.name,
            format_quantity(limit, "rad"),
            format_quantity(near, "m"),
            format_quantity(far, "m"),
            format_quantity(edge, "m")
          )
        )
        fits(run, one, map, book)
        if one.key == "3" then
          local law = eye:axis_law()
          local function depth(focus) return law:depth(focus) or 0 / 0 end
          local function per_step(focus) return depth(focus + 0.5 * mm) - depth(focus - 0.5 * mm) end
          book:number {
            id = "3.resolution_away_from_retina",
            where = "4.1",
            what = "depth in the eye that a millimeter of the sensor covers, at the retina over far from it",
            ours = per_step(near + 0.6 * mm) / per_step(far - 0.6 * mm),
            at_least = 1,
            printed = true,
            reason = '"increased depth resolution" farther from the retina',
            why = "3.2 calls the surfaces denser closer to the retina: that holds for the images of evenly spaced objects",
          }
        end
      end
    end
    book:close()
  end,
}
