-- Localizes a target by focus over the field: angles of 0 to 30 degrees, five surfaces, thirty repetitions (thesis 4.4.5, table
-- 4.1, figure 4.11), in an eye off by table 5.1, calibrated on the retina alone, and with axis and retinal shape; with
-- uncertainties by the GUM and the paraxial model beside it.
-- SPDX-License-Identifier: Apache-2.0
local by_focus = require "calibration.focus_localization"
local expect = require "analysis.expectations"
local eyes = require "session.eyes"
local published = require "analysis.published"
local statistics = require "analysis.statistics"
local targets = require "session.targets"
local units = require "units"
local mm, um, deg = units.mm, units.um, units.deg

local function error_table(run, title, angles, surfaces, cells)
  local header, rows = { "" }, {}
  for k = 1, #surfaces do
    header[k + 1] = ("surface %d (%s)"):format(k, format_quantity(surfaces[k], "m"))
  end
  for i, angle in ipairs(angles) do
    rows[i] = { ("%.0f°"):format(angle / deg) }
    for k = 1, #surfaces do
      local cell = cells[i] and cells[i][k]
      rows[i][k + 1] = cell and ("%.0f(%.0f)"):format(cell.error / um, cell.uncertainty / um) or "–"
    end
  end
  run:table { title = title, header = header, rows = rows }
end

-- Each cell of table 4.1 with how many of its own, parenthesised uncertainties ours is away; how many are within two, and how
-- many of the rest are smaller: {within, smaller, larger}. Nothing where other places were measured.
local function beside_table_4_1(run, angles, surfaces, cells)
  local thesis = published.table_4_1
  if #angles ~= #thesis.angles or #surfaces ~= #thesis.errors[1] then return nil end
  local header, rows, count = { "" }, {}, { within = 0, smaller = 0, larger = 0 }
  for k = 1, #surfaces do
    header[k + 1] = ("surface %d"):format(k)
  end
  for i, angle in ipairs(angles) do
    rows[i] = { ("%.0f°"):format(angle / deg) }
    for k = 1, #surfaces do
      local cell, printed, spread = cells[i] and cells[i][k], thesis.errors[i][k], thesis.uncertainties[i][k]
      local off = cell and (cell.error / um - printed) / spread
      rows[i][k + 1] = cell and ("%.0f beside %d(%d): %+.1f"):format(cell.error / um, printed, spread, off) or "–"
      local where = off and (math.abs(off) <= 2 and "within" or off < 0 and "smaller" or "larger")
      if where then count[where] = count[where] + 1 end
    end
  end
  run:table {
    title = "Errors beside table 4.1, µm, and the difference in the thesis' own uncertainties",
    header = header,
    rows = rows,
  }
  return count
end

-- Figure 4.11: where the targets were, where they were found, and what the paraxial model says of those on the retina.
local function picture(run, angles, surfaces, cells, paraxial)
  local actual, found =
    { label = "actual", x = {}, y = {}, mark = "points" }, { label = "found", x = {}, y = {}, mark = "points" }
  for i = 1, #angles do
    for k = 1, #surfaces do
      local cell = cells[i] and cells[i][k]
      if cell then
        actual.x[#actual.x + 1], actual.y[#actual.y + 1] = cell.place.z, -cell.place.x
        found.x[#found.x + 1], found.y[#found.y + 1] = cell.found.z, -cell.found.x
      end
    end
  end
  run:plot {
    title = "Localization by focus, as figure 4.11",
    equal_aspect = true,
    x = { "before the retina's vertex", "mm" },
    y = { "from the axis", "mm" },
    series = { actual, found, { label = "paraxial, first surface", x = paraxial.z, y = paraxial.x, mark = "dashed" } },
  }
end

local function all_errors(cells, angles, surfaces)
  local errors = {}
  for i = 1, #angles do
    for k = 1, #surfaces do
      if cells[i] and cells[i][k] then errors[#errors + 1] = cells[i][k].error end
    end
  end
  return errors
end

return {
  title = "Localization by focus",
  needs = { "top_camera", "stage", "sample" },
  rig = "bare_sensor",
  parameters = {
    eye = eyes.parameter "perturbed",
    draw = eyes.draw,
    angles = { default = 7, min = 2, max = 31, integer = true, help = "from 0 to the field" },
    field = { unit = "deg", default = 30 * deg, min = 1 * deg, max = 32 * deg, help = "largest angle, at the pupil's center" },
    surfaces = { default = 5, min = 1, max = 20, integer = true, help = "depths before the retina" },
    deepest = { unit = "mm", default = 5 * mm, min = 1 * mm, max = 7 * mm, help = "the last of them" },
    repetitions = { default = 30, min = 1, max = 200, integer = true, help = "images at each position of the sensor" },
    steps = { default = 9, min = 7, max = 200, integer = true, help = "positions of the sensor for each target" },
    eyes = {
      default = 20,
      min = 0,
      max = 1000,
      integer = true,
      help = "perturbed eyes whose images are computed, not rendered",
    },
  },
  run = function(rig, p, run)
    local believed = rig:eye()
    local truth = eyes.set(rig, run, p.eye, p.draw)
    run:defer(function() targets.remove(rig) end)
    local angles, surfaces = statistics.range(0, p.field, p.angles), statistics.range(0.3 * mm, p.deepest, p.surfaces)
    local model = by_focus.model(believed)
    run:progress(0, "calibrating")
    local calibration = by_focus.calibrate(rig, model, angles)
    local retina_only, full = {}, {}
    local deviations = {}
    for i, angle in ipairs(angles) do
      retina_only[i], full[i] = {}, {}
      for k, depth in ipairs(surfaces) do
        run:progress(
          0.1 + 0.8 * ((i - 1) * p.surfaces + k - 1) / (p.angles * p.surfaces),
          ("%.0f°, surface %d"):format(angle / deg, k)
        )
        run:checkpoint(("before %.0f degrees, surface %d"):format(angle / deg, k))
        local place = believed:point_at_field(angle, depth)
        local seen = by_focus.look(rig, model, calibration, place, p)
        if seen then
          deviations[#deviations + 1] = seen.deviation
          retina_only[i][k] = by_focus.locate(model, calibration, seen, place, "retina")
          full[i][k] = by_focus.locate(model, calibration, seen, place, "full")
        else
          run:note(("the target at %.0f degrees, surface %d, was not found sharp"):format(angle / deg, k))
        end
      end
    end
    error_table(run, "Errors (uncertainty), µm, calibrated on the retina alone, as table 4.1", angles, surfaces, retina_only)
    error_table(run, "Errors (uncertainty), µm, with axis and retinal shape", angles, surfaces, full)
    local beside = beside_table_4_1(run, angles, surfaces, full)
    picture(run, angles, surfaces, full, by_focus.paraxial(believed, model, angles))
    eyes.report(run, believed, truth)
    local errors, errors_full = all_errors(retina_only, angles, surfaces), all_errors(full, angles, surfaces)
    local missing = p.angles * p.surfaces - #errors_full
    if #errors_full == 0 then error("no target was localized", 0) end
    run:result("localized", #errors_full)
    run:result("focus_deviation_median", statistics.median(deviations), "m")

    local book = expect.book(run, "table 4.1")
    local thesis = published.table_4_1
    -- A stage that moves exactly leaves 0.04 um of scatter where the thesis' had 83: not the same error, so none is better.
    local told = ("the eye of table 5.3, not chapter 4's undisclosed lens; focus scatters by %s here, by %s there"):format(
      format_quantity(statistics.median(deviations), "m"),
      format_quantity(published.chapter_4.model_eye.depth_of_focus, "m")
    )
    book:number {
      id = "4.1.mean",
      what = "mean error over all places, axis and retinal shape calibrated, as the thesis' was",
      thesis = thesis.mean,
      ours = statistics.mean(errors_full),
      unit = "m",
      why = told,
    }
    book:number {
      id = "4.1.deviation",
      what = "standard deviation of the errors",
      thesis = thesis.deviation,
      ours = statistics.deviation(errors_full),
      unit = "m",
      why = told,
    }
    book:number {
      id = "4.1.retina_mean",
      what = "mean error, calibrated on the retina alone",
      thesis = thesis.mean,
      ours = statistics.mean(errors),
      unit = "m",
      why = told,
    }
    book:number {
      id = "4.1.localized",
      what = "places without an answer",
      ours = missing,
      at_most = 0.05 * p.angles * p.surfaces,
      reason = "one in twenty",
    }
    if beside then
      book:number {
        id = "4.1.cells",
        what = "cells within two of the thesis' uncertainties, of 35",
        ours = beside.within,
        why = ("of the others %d are smaller and %d larger; no goal: it is another lens"):format(beside.smaller, beside.larger),
      }
    end
    if p.eyes > 0 then
      by_focus.with_printed_scatter(book, believed, model, angles, surfaces, p.eyes)
      run:progress(0.9, "other eyes")
      by_focus.many_eyes(run, book, believed, model, angles, surfaces, p.eyes, statistics.median(deviations))
    end
    book:close()
  end,
}
