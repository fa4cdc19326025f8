-- Tracks a robot that is partly occluded: by color alone, and with the learned shape (thesis 8.3.2, figure 8.4; four
-- eigenshapes). On the simulated rig a needle crosses the field above it.
-- SPDX-License-Identifier: Apache-2.0
local color_scene = require "session.color_scene"
local expect = require "analysis.expectations"
local units = require "units"
local vision = require "vision"
local mm, s, deg = units.mm, units.s, units.deg

-- The needle stands aside while the tracker learns, and across the way while it is tested.
local function put_needle(rig, run, across)
  if rig.simulation then
    rig.simulation:move_body("needle", across and vector(0, 0, 4.5 * mm) or vector(0, 0, 0.5))
  elseif
    not run:confirm(across and "hold the needle across the field; is it there?" or "take the needle out of the field; is it out?")
  then
    run:stop "there is no needle to be occluded by"
  end
end

return {
  title = "Tracking behind an occlusion",
  simulated_only = true,
  needs = { "top_camera" },
  rig = "color_occluded",
  parameters = {
    images = { default = 20, min = 3, max = 1000, integer = true, help = "to train with" },
    passes = { default = 3, min = 1, max = 100, integer = true, help = "of the robot under the needle" },
    speed = { unit = "mm/s", default = 1 * mm / s, min = 0.05 * mm / s, max = 3 * mm / s, help = "of each" },
    channels = { default = "RGB", help = "that the color model looks at: RGB, or a pair such as RG" },
  },
  run = function(rig, p, run)
    put_needle(rig, run, false)
    local training = color_scene.training(rig, run, p.images)
    local model = vision.color_model { images = training, channels = p.channels }
    put_needle(rig, run, true)
    run:defer(function() put_needle(rig, run, false) end)
    local found = {
      { name = "color alone", tracker = vision.tracker { model = model, shape_prior = false, refine = false } },
      { name = "color and shape", tracker = vision.tracker { model = model, refine = false } },
      { name = "color, shape and rim", tracker = vision.tracker { model = model } },
    }
    local legs = {}
    for k = 1, p.passes do
      local y = (k - (p.passes + 1) / 2) * 0.8 * mm / math.max(p.passes - 1, 1)
      local turn = (k - 1) * 60 * deg
      local from, to = vector(2.6 * mm, y, 0), vector(-2.6 * mm, y, 0) -- from right to left
      legs[k] = { points = { from, to }, axis = vector(math.cos(turn), math.sin(turn), 0) }
    end
    local frames = {}
    color_scene.watch(rig, run, legs, p.speed, function(frame, arriving)
      local looked = { time = frame.time, tracks = {} }
      for i, one in ipairs(found) do
        looked.tracks[i] = one.tracker:update(frame.image).tracks[1]
      end
      if arriving then return end
      frames[#frames + 1] = looked
      if #frames % 20 == 0 then looked.image = frame.image end
    end)
    run:wait(0.3 * s)
    local view = rig:view()
    for _, one in ipairs(found) do
      one.both = {}
    end
    for _, looked in ipairs(frames) do
      local outline = color_scene.outline(rig, run, looked, view)
      for i, one in ipairs(found) do
        if outline then one.both[#one.both + 1] = { track = looked.tracks[i], outline = outline } end
      end
      if looked.image and outline then
        run:picture {
          title = ("at %.1f s"):format(looked.time),
          image = looked.image:overlay { track = looked.tracks[2], expected = outline },
          note = "color and shape",
        }
      end
    end
    for _, one in ipairs(found) do
      one.errors = color_scene.compare(one.both)
    end
    color_scene.tell(run, "Mean errors, beside figure 8.4", found)
    local alone, shape = found[1].errors, found[3].errors
    local count = #found[1].both
    local book = expect.book(run, "figure 8.4")
    book:number {
      id = "8.4.shape_lost",
      what = "with shape: part of the frames lost or wrong",
      ours = (shape.lost + shape.wrong) / count,
      at_most = 0.1,
      reason = '"the statistical shape information results in successful tracking"',
    }
    book:number {
      id = "8.4.shape_axis",
      what = "with shape, mean error of the long axis over that by color alone",
      ours = shape.major / alone.major,
      at_most = 1,
      reason = "the occlusion cuts off what color alone takes for the whole",
    }
    book:close()
  end,
}
