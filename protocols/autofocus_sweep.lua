-- Depth of the contents of an image window from an autofocus sweep of the sensor, with its uncertainty (thesis 4.1, figure
-- 4.1): of the bench's target, or of any other object in the window.
-- SPDX-License-Identifier: Apache-2.0
local expect = require "analysis.expectations"
local focusing = require "calibration.focus"
local published = require "analysis.published"
local targets = require "session.targets"
local units = require "units"
local vision = require "vision"
local mm, um = units.mm, units.um

return {
  title = "Autofocus sweep",
  needs = { "top_camera", "stage", "sample" },
  rig = "bare_sensor",
  parameters = {
    depth = {
      unit = "mm",
      default = 3 * mm,
      min = 0.1 * mm,
      max = 8 * mm,
      help = "where the target is put, before the retina, on the axis",
    },
    reach = { unit = "mm", default = 0.8 * mm, min = 0.1 * mm, max = 8 * mm, help = "of the sweep, either way" },
    steps = { default = 21, min = 5, max = 1000, integer = true, help = "positions of the sensor" },
    repetitions = { default = 5, min = 1, max = 200, integer = true, help = "images at each position" },
    window = { default = 120, min = 16, max = 2000, integer = true, help = "side of the window, px" },
    measure = {
      choices = vision.focus_measures(),
      default = "smoothed_tenengrad",
      help = "normalized_variance is the thesis'",
    },
  },
  run = function(rig, p, run)
    local eye = rig:eye()
    local map = eye:wide_angle_map()
    local expected = map:image { 0, 0, p.depth }
    targets.put(rig, vector(0, 0, p.depth))
    run:defer(function() targets.remove(rig) end)
    local pixel = focusing.pixel(rig, expected)
    local window = { u = pixel.u, v = pixel.v, size = p.window }
    local sweep = focusing.sweep(rig, {
      from = expected.z - p.reach,
      to = expected.z + p.reach,
      steps = p.steps,
      frames = p.repetitions,
      window = window,
      measure = p.measure,
    })
    local found = focusing.summary(sweep.peaks)
    if found.count == 0 then
      error("the sweep found no peak: " .. sweep.peaks[1].answer .. "; is the target in the window?", 0)
    end
    run:plot {
      title = "Focus against the sensor's place",
      x = { "d_ls", "mm" },
      y = { p.measure, "" },
      series = { { label = "first sweep", x = sweep.distances, y = sweep.values, mark = "points" } },
    }
    local place = map:locate({ 0, 0, found.mean }, { image_sigma = 3 * um, focus_sigma = math.max(found.deviation, 1e-9) })
    if not place then error("where it was sharpest is no place in the eye: d_ls " .. format_quantity(found.mean, "m"), 0) end
    focusing.move(rig, found.mean)
    local sharp = rig.top_camera:grab({ fresh = true }).image
    run:picture { title = "in focus", image = sharp, note = "d_ls " .. format_quantity(found.mean, "m") }
    run:result("sharpest_at", found.mean, "m")
    run:result("sharpest_deviation", found.deviation, "m")
    run:result("depth", place.position.z, "m")
    run:result("depth_sigma", place.sigma.z, "m")
    run:note(
      ("sharpest at d_ls %s, %d sweeps of %d agree to %s; %s before the retina ± %s, uncalibrated"):format(
        format_quantity(found.mean, "m"),
        found.count,
        found.count + found.failed,
        format_quantity(found.deviation, "m"),
        format_quantity(place.position.z, "m"),
        format_quantity(place.sigma.z, "m")
      )
    )
    local book = expect.book(run, "4.4.3")
    book:number {
      id = "4.4.focus_deviation",
      what = "scatter of the in-focus sensor position",
      thesis = published.chapter_4.model_eye.depth_of_focus,
      ours = found.deviation,
      unit = "m",
      why = "the thesis takes its depth of focus as the variance to be expected; the bench's stage moves exactly, so ours is "
        .. "what the pixels' noise leaves",
    }
    book:number {
      id = "4.4.sweeps_found",
      what = "part of the sweeps that found a peak",
      ours = found.count / (found.count + found.failed),
      at_least = 0.9,
      reason = "this project's goal",
    }
    book:close()
  end,
}
