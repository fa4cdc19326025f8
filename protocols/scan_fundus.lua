-- Scans the retina with a small sensor that is turned about the axis, focuses at each view, and joins the views to one picture
-- (thesis appendix A, figures A.3 and A.4).
-- SPDX-License-Identifier: Apache-2.0
local expect = require "analysis.expectations"
local focusing = require "calibration.focus"
local statistics = require "analysis.statistics"
local units = require "units"
local vision = require "vision"
local mm, um, deg = units.mm, units.um, units.deg

return {
  title = "Fundus scan",
  needs = { "top_camera", "stage", "rotation_stage" },
  rig = "fundus_scanner",
  parameters = {
    views = { default = 12, min = 2, max = 60, integer = true, help = "of one turn" },
    turn = { unit = "deg", default = 180 * deg, min = 10 * deg, max = 360 * deg, help = "from the first view to the last" },
    reach = { unit = "mm", default = 1 * mm, min = 0.1 * mm, max = 5 * mm, help = "of the search for focus, either way" },
    refocus = { default = true, help = "at each view; else at the first alone" },
  },
  run = function(rig, p, run)
    local info = rig.top_camera:info()
    local near, images, focus, angles = rig:eye():axial_image(0).distance, {}, {}, statistics.range(0, p.turn, p.views)
    local size = math.min(info.width_px, info.height_px) - 20
    local window = { u = (info.width_px - 1) / 2, v = (info.height_px - 1) / 2, size = size }
    for i, angle in ipairs(angles) do
      run:progress((i - 1) / p.views, ("view %d of %d"):format(i, p.views))
      run:checkpoint("before view " .. i)
      rig.rotation_stage:move_to(angle)
      if i == 1 or p.refocus then
        local told = focusing.autofocus(
          rig,
          { near = focus[1] or near, reach = focus[1] and p.reach or 2 * p.reach, step = 50 * um, window = window }
        )
        if told.answer ~= "found" then error(("view %d: no focus was found: %s"):format(i, told.answer), 0) end
        focus[i] = told.position
      else
        focus[i] = focus[1]
      end
      images[i] = rig.top_camera:grab({ fresh = true }).image
    end
    rig.rotation_stage:move_to(0)
    run:progress(0.95, "joining")
    local made = vision.mosaic { images = images, max_rotation = math.min(1.5 * p.turn / (p.views - 1), 3.1) }
    run:picture { title = "mosaic", image = made.image, note = ("%d views joined"):format(made.joined) }
    run:picture { title = "first view", image = images[1], note = "d_ls " .. format_quantity(focus[1], "m") }
    made.image:save("mosaic.png")
    run:plot {
      title = "Where each view was sharp",
      x = { "view", "" },
      y = { "d_ls", "mm" },
      series = { { label = "focus", x = statistics.range(1, p.views, p.views), y = focus, mark = "points" } },
    }
    local joined = made.image:info()
    run:result("views_joined", made.joined)
    run:result("seam_rms_px", made.rms_px)
    run:result("mosaic_pixels", joined.width_px * joined.height_px)
    local book = expect.book(run, "appendix A")
    book:number {
      id = "A.joined",
      what = "views that were joined, of " .. p.views,
      ours = made.joined,
      at_least = p.views,
      reason = '"we tested the autofocusing and mosaicing concept of our device": all of them',
    }
    book:number {
      id = "A.seams",
      what = "how well neighbors agree, px rms",
      ours = made.rms_px,
      at_most = 0.5,
      reason = "half a pixel",
    }
    book:number {
      id = "A.focus_spread",
      what = "scatter of focus over the views",
      ours = statistics.deviation(focus),
      unit = "m",
      at_most = 95 * um,
      reason = "the depth of focus of 4.1: the retina turns about the axis",
    }
    book:close()
  end,
}
