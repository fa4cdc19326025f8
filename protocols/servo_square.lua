-- Drives the robot round a rectangle in the vertical plane that the side camera sees, watched by the top
-- camera alone (thesis 6.2, figure 6.5), and says how far from the path it was.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local paths = require "paths"
local judge = require "judge"
local mm, um, s, mT = units.mm, units.um, units.s, units.mT

local centre = vector(0, 0, 0)

-- The thesis' hand trim ("manually adjusted for local stability at the center", 6.1), by measurement: at rest in the centre,
-- what the loop has to add all the time is what the model lacks.
local function trim(servo)
  for _ = 1, 2 do
    servo:go_to(centre, { within = 400*um, settle = 2*s })
    servo:trim(vector(servo:trim()) + servo:mean_correction(3*s))
  end
end

return {
  title = "Servo round a square",
  needs = { "top_camera", "coils", "sample" },
  parameters = {
    width = { unit = "mm", default = 8*mm, min = 1*mm, max = 9*mm, help = "along x" },
    depth = { unit = "mm", default = 6*mm, min = 1*mm, max = 7*mm, help = "along the eye's axis" },
    speed = { unit = "mm/s", default = 0.5*mm/s, min = 0.05*mm/s, max = 2*mm/s, help = "along the path" },
    field = { unit = "mT", default = 10*mT, min = 2*mT, max = 30*mT, help = "magnitude of the magnetic field" },
    law = { choices = { "pd", "estimator" }, default = "pd", help = "pd is the thesis'" },
    laps = { default = 1, min = 1, max = 20, integer = true, help = "times round" },
  },
  run = function(rig, p, run)
    local square = paths.rectangle { width = p.width, depth = p.depth, centre = centre, laps = p.laps }

    run:progress(0, "learning the empty scene")
    rig.sample:remove_robot()
    local background = rig:learn_background { frames = 15 }

    run:progress(0.02, "bringing the robot in")
    local servo <close> = rig:servo { background = background, law = p.law, field = p.field, axis = { 1, 0, 0 } }
    servo:hold(centre)
    rig.sample:insert_robot(centre)
    servo:wait_until_tracked { timeout = 10*s }

    run:progress(0.05, "trimming at the centre")
    run:checkpoint("before the trim")
    trim(servo)
    servo:snapshot("at the centre, trimmed")

    run:progress(0.2, "going to the first corner")
    run:checkpoint("before the path")
    servo:go_to(square[1], { speed = p.speed, within = 400*um, timeout = 60*s })
    servo:snapshot("at the first corner")

    local from = run:now()
    run:progress(0.3, "round the square")
    servo:follow(square, { speed = p.speed, progress_to = 0.99, pictures = 3, label = "round the square" })
    servo:snapshot("at the end of the path")
    local to = run:now()
    run:wait(0.2*s)

    judge.path(run, { from = from, to = to, square = square })
  end,
}
