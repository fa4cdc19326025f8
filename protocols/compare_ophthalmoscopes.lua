-- Comparison of three methods of ophthalmoscopy: direct, with a vitrectomy lens, with a condensing lens (thesis 3.1, tables
-- 3.1 to 3.3, figures 3.2b, 3.3b, 3.4b). For each: the image position of an object on the axis, the visible part of the
-- retina, and the requirements on a microscope.
-- SPDX-License-Identifier: Apache-2.0
local expect = require "analysis.expectations"
local optics = require "optics"
local published = require "analysis.published"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, um, deg = units.mm, units.um, units.deg

local methods = {
  { key = "direct", name = "navarro", title = "direct (table 3.1)", figure = "figure 3.2b", view = "observer_distance" },
  {
    key = "vitrectomy",
    name = "navarro_vitrectomy",
    title = "vitrectomy lens (table 3.2)",
    figure = "figure 3.3b",
    view = "contact_radius",
  },
  {
    key = "indirect",
    name = "navarro_condensing_conic",
    title = "condensing lens (table 3.3)",
    figure = "figure 3.4b",
    view = "lens_radius",
  },
}

-- Where objects on the axis are imaged: by first order and by the least spot of traced rays.
local function image_curve(run, eye, method, depths)
  local first, traced = {}, {}
  for i, depth in ipairs(depths) do
    first[i] = (eye:axial_image(depth) or { distance = 0 / 0 }).distance
    traced[i] = (eye:spot { depth = depth } or { best_focus = 0 / 0 }).best_focus
  end
  run:plot {
    title = ("Image against object, %s, as %s"):format(method.title, method.figure),
    x = { "object before the retina", "mm" },
    y = { "image behind the last surface", "mm" },
    series = {
      { label = "first order", x = depths, y = first },
      { label = "least spot", x = depths, y = traced, mark = "dashed" },
    },
  }
  return first
end

return {
  title = "Ophthalmoscopy methods compared",
  parameters = {
    observer_distance = {
      unit = "mm",
      default = 15 * mm,
      min = 1 * mm,
      max = 1,
      help = "direct: the observer's pupil before the cornea",
    },
    contact_radius = {
      unit = "mm",
      default = 2.1 * mm,
      min = 0.1 * mm,
      max = 20 * mm,
      help = "clear radius of the vitrectomy lens' flat face",
    },
    lens_radius = { unit = "mm", default = 14 * mm, min = 1 * mm, max = 50 * mm, help = "clear radius of the condensing lens" },
    nearest = { unit = "mm", default = 1 * mm, min = 0.1 * mm, max = 5 * mm, help = "nearest object in the curves" },
    farthest = { unit = "mm", default = 10 * mm, min = 1 * mm, max = 15 * mm, help = "and the farthest" },
  },
  run = function(_, p, run)
    local depths = statistics.range(p.nearest, p.farthest, 19)
    local book, rows, found = expect.book(run, "3.1"), {}, {}
    for _, method in ipairs(methods) do
      local eye = optics.system { name = method.name }
      run:picture { title = "Layout: " .. method.title, svg = eye:layout { angles = { 0, 5 * deg } } }
      local images = image_curve(run, eye, method, depths)
      local view = method.key == "direct" and { observer_distance = p.observer_distance } or { clear_radius = p[method.view] }
      local field = eye:viewing(view).field_of_view
      local retina = eye:axial_image(0) or { distance = -math.huge, magnification = math.huge }
      found[method.key] =
        { retina = retina, span = math.abs(images[#images] - images[1]), first = images[1], last = images[#images] }
      rows[#rows + 1] = {
        method.title,
        format_quantity(field.angle, "rad"),
        field.limit,
        format_quantity(retina.distance, "m"),
        format_quantity(images[1], "m"),
        format_quantity(images[#images], "m"),
        ("%.3g"):format(retina.magnification),
      }
      book:number {
        id = "3.1.field_of_view." .. method.key,
        what = "field of view, " .. method.title,
        thesis = published.field_of_view[method.key],
        ours = field.angle,
        unit = "rad",
        within = method.key == "direct" and 1 * deg or nil,
        at_most = method.key ~= "direct" and published.field_of_view[method.key] or nil,
        at_least = method.key ~= "direct" and 0.9 * published.field_of_view[method.key] or nil,
        printed = method.key ~= "direct",
        reason = method.key == "direct" and '"~10 degrees": the nearest ten, to a tenth of it' or '"up to", to a tenth of it',
        why = method.key == "indirect" and '"up to 100 degrees" over commercial lenses; this one loses its rays beyond 91'
          or "the thesis names no observer distance and no lens diameter: assumed, parameters of this protocol",
      }
    end
    run:table {
      title = "What each method sees",
      rows = rows,
      header = {
        "method",
        "field of view",
        "limited by",
        "image of the retina",
        "of the nearest object",
        "of the farthest",
        "magnification",
      },
    }
    book:number {
      id = "3.1.direct_retina_image",
      what = "direct: the retina's image is at infinity, so farther than",
      where = "figure 3.2b",
      ours = math.abs(found.direct.retina.distance),
      unit = "m",
      at_least = 1,
      reason = "a meter is beyond any microscope's working distance",
    }
    book:number {
      id = "3.1.vitrectomy_retina_image",
      what = "vitrectomy: working distance to the retina's virtual image",
      where = "3.1.2",
      thesis = published.vitrectomy_working_distance,
      ours = -found.vitrectomy.retina.distance,
      unit = "m",
      within = 1 * mm,
      reason = '"at least 20 mm", a number of two digits, read off a curve',
      why = "first order from the printed table",
    }
    book:number {
      id = "3.1.span_vitrectomy_over_direct",
      what = "span of the images, vitrectomy over direct",
      where = "figure 3.3b",
      ours = found.vitrectomy.span / found.direct.span,
      at_most = 1,
      printed = true,
      reason = '"span a lesser distance"',
    }
    book:number {
      id = "3.1.aerial_image_real",
      what = "condensing: the aerial image of the retina lies before the observer",
      where = "figure 3.4b",
      ours = found.indirect.retina.distance,
      unit = "m",
      at_least = 0,
      printed = true,
      reason = "an aerial image is a real one",
    }
    book:number {
      id = "4.1.magnification",
      what = "condensing: magnification of the retina",
      where = "4.1",
      thesis = published.chapter_4.magnification,
      ours = math.abs(found.indirect.retina.magnification),
      within = 0.01,
      why = "0.769 in the tables' arithmetic: 0.76 is cut, not rounded",
      reason = "the last digit printed",
    }
    local condensing = optics.system { name = "navarro_condensing" }
    book:number {
      id = "4.1.numerical_aperture",
      what = "condensing: numerical aperture",
      where = "4.1",
      thesis = published.chapter_4.numerical_aperture,
      ours = condensing:viewing().numerical_aperture.oslo,
      within = 0.0005,
      reason = "half the last digit printed",
    }
    book:number {
      id = "4.1.depth_of_focus",
      what = "condensing: depth of focus (4.1)",
      where = "4.1",
      thesis = published.chapter_4.depth_of_focus,
      ours = condensing:viewing().depth_of_focus.thesis,
      unit = "m",
      within = 1 * um,
      reason = "the last digit printed",
      why = "as printed: the index of the object's side with the aperture of the image's",
    }
    book:number {
      id = "4.1.depth_of_field",
      what = "condensing: depth of field",
      where = "4.1",
      thesis = published.chapter_4.depth_of_field,
      ours = condensing:viewing().depth_of_field.thesis,
      unit = "m",
      within = 10 * um,
      reason = '"approximately 150 µm", read off a slope',
    }
    book:close()
  end,
}
