-- A robot pushes a disc over a surface, and both are tracked by their colors, touching or not (thesis 8.3.1, figures 8.2 and
-- 8.3). On the simulated rig the robot is steered by its pose sensor in place of the operator.
-- SPDX-License-Identifier: Apache-2.0
local expect = require "analysis.expectations"
local units = require "units"
local vision = require "vision"
local mm, s, mT = units.mm, units.s, units.mT

-- Images of one object alone, with its outline by what differs from the empty scene: what a hand would paint.
local function learn_one(rig, empty, show, count)
  local made = {}
  for k = 1, count do
    show(k)
    rig.top_camera:grab()
    rig.top_camera:grab()
    local image = rig.top_camera:grab().image
    local tracker = vision.background_tracker { threshold = 15, min_area_px = 30 }
    for _, one in ipairs(empty) do
      tracker:learn(one)
    end
    local outline = tracker:update(image)
    if outline then made[#made + 1] = { image = image, mask = image:ellipse_mask(outline), name = tostring(k) } end
  end
  if #made < 2 then error("too few images of the object alone: is it in the field?", 0) end
  return made
end

local away = vector(0, 0, 0.5)

return {
  title = "Pushing a disc",
  simulated_only = true,
  needs = { "top_camera", "coils", "sample" },
  rig = "push_discs",
  parameters = {
    images = { default = 8, min = 2, max = 100, integer = true, help = "of each object alone, to train with" },
    way = { unit = "mm", default = 3 * mm, min = 0.5 * mm, max = 6 * mm, help = "that the robot goes" },
    speed = { unit = "mm/s", default = 0.5 * mm / s, min = 0.05 * mm / s, max = 2 * mm / s, help = "along it" },
    height = { unit = "mm", default = -4.2 * mm, min = -4.5 * mm, max = 2 * mm, help = "at which the robot goes, world" },
  },
  run = function(rig, p, run)
    local disc_at = vector(0.4 * mm, 0, -4.65 * mm)
    rig.sample:remove_robot()
    rig.simulation:move_body("disc", away)
    local empty = {}
    for k = 1, 3 do
      empty[k] = rig.top_camera:grab().image
    end
    local discs = learn_one(
      rig,
      empty,
      function(k) rig.simulation:move_body("disc", disc_at + vector(0.3 * mm * (k % 3 - 1), 0.2 * mm * (k % 2), 0)) end,
      p.images
    )
    rig.simulation:move_body("disc", away)
    local start = vector(-p.way / 2 - 1 * mm, 0, p.height)
    local servo <close> = rig:servo {
      feedback = "pose_sensor",
      law = "estimator",
      field = 15 * mT,
      axis = { 1, 0, 0 },
      lost_timeout = 5 * s,
      touch = true, -- the discs lie on the retina
    }
    servo:hold(start)
    rig.sample:insert_robot(start)
    servo:wait_until_tracked()
    local robots = learn_one(
      rig,
      empty,
      function(k)
        servo:go_to(start + vector(0.2 * mm * (k % 4), 0.1 * mm * (k % 3 - 1), 0), { within = 0.5 * mm, settle = 0.2 * s })
      end,
      p.images
    )
    local models = { vision.color_model { images = robots }, vision.color_model { images = discs } }
    local tracker = vision.tracker { models = models, shape_prior = true }
    servo:go_to(start, { within = 0.3 * mm, settle = 0.3 * s })
    rig.simulation:move_body("disc", disc_at)
    run:wait(1 * s)
    local frames, going = {}, true
    run:together(function()
      servo:follow({ start, start + vector(p.way, 0, 0) }, { speed = p.speed, label = "pushing" })
      going = false
    end, function()
      while going do
        local frame = rig.top_camera:grab()
        local tracks = tracker:update(frame.image).tracks
        frames[#frames + 1] =
          { time = frame.time, robot = tracks[1], disc = tracks[2], image = #frames % 25 == 0 and frame.image or nil }
      end
    end)
    local x, robot_u, disc_u, lost, both = {}, {}, {}, 0, 0
    for i, frame in ipairs(frames) do
      x[i] = frame.time
      robot_u[i] = frame.robot.x_px or 0 / 0
      disc_u[i] = frame.disc.x_px or 0 / 0
      if frame.robot.x_px and frame.disc.x_px then
        both = both + 1
      else
        lost = lost + 1
      end
      if frame.image then
        run:picture {
          title = ("at %.1f s"):format(frame.time),
          image = frame.image:overlay { track = frame.robot, expected = frame.disc.x_px and frame.disc or nil },
          note = "robot; dashed: disc",
        }
      end
    end
    if both < 2 then error("the two were not tracked together in two frames", 0) end
    run:plot {
      title = "Where both were seen, as figures 8.2 and 8.3",
      x = { "time", "s" },
      y = { "along the image, px", "" },
      series = { { label = "robot", x = x, y = robot_u }, { label = "disc", x = x, y = disc_u, mark = "dashed" } },
    }
    local function first_and_last(list)
      local first, last
      for _, value in ipairs(list) do
        if value == value then
          first, last = first or value, value
        end
      end
      return first, last
    end
    local pixel = rig.top_camera:info().effective_pixel
    local from, to = first_and_last(disc_u)
    local robot_from, robot_to = first_and_last(robot_u)
    run:result("disc_pushed", (to - from) * pixel, "m")
    run:result("robot_went", (robot_to - robot_from) * pixel, "m")
    local swapped = 0
    for i = 1, #frames do
      if robot_u[i] > disc_u[i] then swapped = swapped + 1 end
    end
    local book = expect.book(run, "figure 8.2")
    book:number {
      id = "8.2.both_tracked",
      what = "part of the frames in which robot and disc are tracked",
      ours = both / #frames,
      at_least = 0.9,
      reason = '"the microdevice and three disks can be successfully tracked"',
    }
    book:number {
      id = "8.2.pushed",
      what = "way of the disc, seen by the camera",
      ours = (to - from) * pixel,
      unit = "m",
      at_least = 0.3 * mm,
      reason = "it was pushed, and its track went with it",
    }
    book:number {
      id = "8.3.swapped",
      what = "frames in which the two were taken for one another",
      where = "figure 8.3",
      ours = swapped,
      at_most = 0,
      reason = "this project's goal; the figure shows none",
    }
    book:close()
  end,
}
