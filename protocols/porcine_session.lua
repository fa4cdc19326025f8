-- A session with a cadaver porcine eye, from the slaughterhouse's box to the report (thesis 7.2 to 7.4): check-list with
-- photographs, the three to four hours counted down, repeated moisturizing, the order of focusing (iris, then the BIOM on the
-- retina, then the field of view), light, insertion, motion trials with velocity control, tracking, notes. The operator is
-- asked; answers may be given in advance (--answer NAME=VALUE).
-- SPDX-License-Identifier: Apache-2.0
local checklist = require "session.checklist"
local published = require "analysis.published"
local units = require "units"
local vision = require "vision"
local mm, s, mT = units.mm, units.s, units.mT

local center = vector(0, 0, 0)

local function prepare(list, p)
  list:must(
    "enucleated within the last two hours, never frozen, carried in tap water at low room temperature",
    { name = "eye_fresh" }
  )
  list:photograph("the eye as it came", { name = "photo_eye" })
  list:item("cornea and lens clear: structure behind the pupil can be seen", { name = "eye_clear" })
  if p.optics == "removed" then
    list:must(
      "cornea dissected at its rim above the pars plana; lens and iris taken out; the vitreous is whole",
      { name = "opened" }
    )
  else
    list:must("epithelium of the cornea taken off with the stab knife", { name = "epithelium" })
    list:must("infusion of tap water in place, at a steady pressure", { name = "infusion" })
  end
  list:must("eye fixed in the holder, under the microscope, in the middle of the coils", { name = "fixed" })
  list:photograph("the eye in its holder", { name = "photo_holder" })
end

local function light(list, p)
  if p.light == "transscleral" then
    list:must("LED fibre below the eye, light through the sclera; no bright rim on the image", { name = "light" })
  else
    list:must(
      "incision at the pars plana, endoilluminator in; its magnetic tip well away from where the robot goes",
      { name = "light" }
    )
  end
end

-- The thesis' order, "easy but not intuitive".
local function focus(list, rig, run, p)
  if p.optics ~= "removed" then
    list:must("BIOM swung out: microscope focused on the iris", { name = "focus_iris" })
    list:photograph("the iris in focus", { name = "photo_iris" })
  end
  list:must("BIOM swung in", { name = "biom_in" })
  if rig.lens_mover then
    if not rig.lens_mover:info().homed then rig.lens_mover:home() end
    local best, best_value = rig.lens_mover:position(), -math.huge
    for _, at in ipairs { -1 * mm, -0.5 * mm, 0, 0.5 * mm, 1 * mm } do
      rig.lens_mover:move_to(at)
      rig.top_camera:grab()
      local value = rig.top_camera:grab().image:focus().value
      if value > best_value then
        best, best_value = at, value
      end
    end
    rig.lens_mover:move_to(best)
    run:note("condensing lens left at " .. format_quantity(best, "m") .. ", where the retina is sharpest")
  else
    list:must("condensing lens moved until the retina is sharp", { name = "focus_retina" })
  end
  list:item("working distance changed until the field of view is as wanted: the focus stays", { name = "field_of_view" })
  list:photograph("the retina", { name = "photo_retina" })
end

-- One way there and back; how far it came, or why not.
local function trial(rig, run, p, background, number)
  local law = p.law
  local servo <close> = rig:servo { background = background, law = law, field = p.field, lost_timeout = 5 * s }
  servo:hold(center)
  servo:wait_until_tracked()
  local from = servo:position()
  local target = center + vector(p.way * (number % 2 == 1 and 1 or -1), 0, 0)
  local done, problem = pcall(servo.go_to, servo, target, { speed = p.speed, within = 0.5 * mm, settle = 0, timeout = 30 * s })
  local to = servo:status().position or from
  servo:snapshot("trial " .. number)
  run:record("trial", { number = number, moved = (to - from):norm(), arrived = done and 1 or 0 }, { moved = "m" }, {
    number = "number of the trial, from 1",
    moved = "how far the robot came",
    arrived = "1: it came to its target in time",
  })
  return { tostring(number), format_quantity((to - from):norm(), "m"), done and "arrived" or tostring(problem):match("[^:]*$") },
    (to - from):norm()
end

-- Tracking by background subtraction (7.3), beside the loop's own: how much of the time it sees the robot.
local function track(rig, run, p)
  local tracker, seen, frames = vision.background_tracker { kind = "fixed" }, 0, 0
  rig.sample:remove_robot()
  for _ = 1, 5 do
    tracker:learn(rig.top_camera:grab().image)
  end
  rig.sample:insert_robot(center)
  for _ = 1, p.tracked do
    local found = tracker:update(rig.top_camera:grab().image)
    frames, seen = frames + 1, seen + (found and 1 or 0)
  end
  run:result("tracked_part", seen / frames)
end

return {
  title = "Porcine eye session",
  needs = { "top_camera", "coils", "sample" },
  parameters = {
    optics = {
      choices = { "intact", "removed" },
      default = "removed",
      help = "of the eye: cornea and lens (7.4), or taken out (7.2.1)",
    },
    light = { choices = { "transscleral", "endoilluminator" }, default = "transscleral", help = "how the eye is lit" },
    trials = { default = 4, min = 1, max = 100, integer = true, help = "of motion" },
    way = { unit = "mm", default = 1 * mm, min = 0.1 * mm, max = 4 * mm, help = "of each trial, to the right and to the left" },
    speed = { unit = "mm/s", default = 0.5 * mm / s, min = 0.05 * mm / s, max = 2 * mm / s, help = "wanted" },
    law = {
      choices = { "velocity", "estimator", "pd" },
      default = "velocity",
      help = "velocity: for gels, which store what a PID pushes (7.3)",
    },
    field = { unit = "mT", default = 10 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
    moisten = { unit = "s", default = 300 * s, min = 10 * s, max = 3600 * s, help = "between reminders to moisten the cornea" },
    tracked = { default = 15, min = 2, max = 10000, integer = true, help = "frames of the tracking trial" },
  },
  run = function(rig, p, run)
    local list = checklist.new(run, rig, { window = published.porcine_window })
    local _ <close> = run:remind("moisturize the cornea: Lacrinorm gel, or water", { every = p.moisten })
    run:progress(0, "preparing")
    prepare(list, p)
    list:tell_time()
    light(list, p)
    run:progress(0.2, "focusing")
    focus(list, rig, run, p)
    list:tell_time()
    run:progress(0.4, "inserting")
    rig.sample:remove_robot()
    local background = rig:learn_background { frames = 10 }
    list:must("everybody clear of the coils; the robot is in its pipette", { name = "clear" })
    rig.sample:insert_robot(center)
    list:photograph("after insertion", { name = "photo_robot" })
    local rows, most = {}, 0
    for number in run:each(p.trials, "trial") do
      run:checkpoint("before trial " .. number)
      if list:tell_time() == false then break end
      run:wait(0.2 * s) -- the next loop's currents must not follow the last one's at once
      local row, moved = trial(rig, run, p, background, number)
      rows[number], most = row, math.max(most, moved)
    end
    run:table { title = "Motion trials", header = { "trial", "moved", "end" }, rows = rows }
    run:result("moved_most", most, "m")
    track(rig, run, p)
    list:note("the session", { name = "notes" })
    list:item(
      "coils off, robot taken out with the magnet, eye disposed of as the rules say, tools cleaned",
      { name = "cleared_up" }
    )
    list:report "The session, as it went"
    run:result("time_used", run:now() - list.began, "s")
    run:result("time_left", list:left().least, "s")
  end,
}
