-- Steering by hand: the loop holds the robot at the target that the operator points at in the live view (thesis 6.2, figure
-- 6.7), or takes it along the path that was drawn there; a SpaceMouse moves the depth up and down. `vitreo view` runs this; it
-- ends by the page's STOP, Ctrl-C, or after the duration. Where the bench was set up by hand the robot is looked at on the retina
-- first: near it a target would be refused else.
-- SPDX-License-Identifier: Apache-2.0
local by_hand = require "session.manual_control"
local retina = require "calibration.retina"
local units = require "units"
local mm, um, s, mT = units.mm, units.um, units.s, units.mT

return {
  title = "Steering by hand",
  needs = { "top_camera", "coils", "sample" },
  parameters = {
    duration = { unit = "min", default = 60 * 60 * s, min = 1 * s, max = 5 * 3600 * s, help = "then it ends by itself" },
    within = { unit = "um", default = 300 * um, min = 20 * um, max = 2 * mm, help = "so near, the path's next place is due" },
    calibrate = retina.parameter "when",
    field = { unit = "mT", default = 10 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
  },
  run = function(rig, p, run)
    rig.sample:remove_robot()
    local background = rig:learn_background { frames = 15 }
    local view
    if retina.wanted(rig, run, p.calibrate) then
      view = retina.view(rig, run, background, { field = p.field, axis = { 1, 0, 0 }, snapshot = "on the retina" })
      run:wait(0.2 * s) -- the next loop's currents must not follow these at once
    end
    local servo <close> = rig:servo { background = background, field = p.field, view = view }
    local center = vector(0, 0, 0)
    servo:hold(center)
    rig.sample:insert_robot(center)
    servo:wait_until_tracked { timeout = 10 * s }
    run:note("point at a place in the live view, or draw a path")

    local places, next_place, given, checked, last = { center }, 1, 0, run:now(), run:now()
    while run:now() < p.duration do
      if run:now() - checked >= 1 * s then
        run:checkpoint("steering") -- here a pause takes effect
        checked = run:now()
      end
      local wanted = run:operator_target()
      if wanted then
        places, next_place, given = wanted, 1, given + 1
        servo:hold(places[1])
        run:note(
          ("target %d: %s, %s, %s%s"):format(
            given,
            format_quantity(places[1].x, "m"),
            format_quantity(places[1].y, "m"),
            format_quantity(places[1].z, "m"),
            #places > 1 and (", the first of %d"):format(#places) or ""
          )
        )
      end
      local jogged = by_hand.jogged(rig, places[#places], run:now() - last)
      last = run:now()
      if jogged and by_hand.hold(run, servo, jogged) then
        places, next_place = { jogged }, 1
      end
      local here = servo:position()
      if places[next_place + 1] and here and (here - places[next_place]):norm() < p.within then
        next_place = next_place + 1
        servo:hold(places[next_place])
      end
      run:wait(0.1 * s)
    end
    run:result("targets_given", given)
  end,
}
