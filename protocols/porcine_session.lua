-- A session with a cadaver porcine eye, from the slaughterhouse's box to the report (thesis 7.2 to 7.4): check-list with
-- photographs, the three to four hours counted down, repeated moisturizing, light and scleral clearing with its timer, the
-- order of focusing (iris, then the BIOM on the retina, then the field of view), vitrectomy where the robot wants one,
-- insertion, motion trials with velocity control, tracking by background subtraction meanwhile, notes. The operator is asked;
-- answers may be given in advance (--answer NAME=VALUE). docs/porcine_session.md has where each sentence of the thesis is.
-- SPDX-License-Identifier: Apache-2.0
local checklist = require "session.checklist"
local endoilluminator = require "session.endoilluminator"
local published = require "analysis.published"
local steps = require "session.porcine_steps"
local units = require "units"
local vision = require "vision"
local mm, s, mT, minute = units.mm, units.s, units.mT, units.min

local center = vector(0, 0, 0)

-- "6,6,4": a place in mm, world.
local function place_of(text)
  local x, y, z = text:match "^%s*([-%d.eE]+)%s*,%s*([-%d.eE]+)%s*,%s*([-%d.eE]+)%s*$"
  if not (tonumber(x) and tonumber(y) and tonumber(z)) then error(("tip: %q is not x,y,z in mm"):format(text), 0) end
  return vector(tonumber(x) * mm, tonumber(y) * mm, tonumber(z) * mm)
end

-- The endoilluminator's tip, if that is the light: what it adds to the field is told, and how near it may come.
local function tip_of(run, p)
  if p.light ~= "endoilluminator" then return nil end
  local tip = endoilluminator.new(place_of(p.tip), p.tip_margin, p.field)
  for _, at in ipairs { { "center", tip:distance(center) }, { "margin", p.tip_margin } } do
    local background = tip:background(at[2])
    run:result("tip_field_" .. at[1], background.field, "T")
    run:note(
      ("the endoilluminator's tip, %s away (%s), adds at most %s and %.1f mT/m"):format(
        format_quantity(at[2], "m"),
        at[1] == "center" and "of the workspace's center" or "the margin",
        format_quantity(background.field, "T"),
        background.gradient * 1e3
      )
    )
  end
  return tip
end

-- Background subtraction (7.3) beside the loop's own tracker while the robot moves: {frames, seen, steps in px}.
local function tracker_for(rig)
  local tracker = vision.background_tracker { kind = "fixed" }
  for k = 1, 5 do
    tracker:learn(rig.top_camera:grab({ fresh = k == 1 }).image)
  end
  return { tracker = tracker, frames = 0, seen = 0, way = 0 }
end

local function track(rig, tracking, going_on)
  local last
  while going_on() do
    local found = tracking.tracker:update(rig.top_camera:grab().image)
    tracking.frames, tracking.seen = tracking.frames + 1, tracking.seen + (found and 1 or 0)
    if found and last then tracking.way = tracking.way + ((found.x_px - last.x_px) ^ 2 + (found.y_px - last.y_px) ^ 2) ^ 0.5 end
    last = found or last
  end
end

-- Goes there; meanwhile the tracker and the tip's interlock watch. What `go_to` says when it does not arrive is returned.
local function go(rig, run, p, servo, target, tracking, tip)
  if tip then tip:check_way(servo:position(), target) end
  local there, problem, stopped = false, nil, false
  local function moving() return not stopped end
  local tasks = {
    function()
      there, problem = pcall(servo.go_to, servo, target, { speed = p.speed, within = 0.5 * mm, settle = 0, timeout = 30 * s })
      stopped = true
    end,
    function()
      track(rig, tracking, function() return not stopped and tracking.frames < p.tracked end)
    end,
  }
  if tip then tasks[3] = function() tip:watch(run, servo, moving) end end
  run:together(table.unpack(tasks))
  return there, problem
end

-- One way to the right or to the left; how far it came, or why not.
local function trial(rig, run, p, background, number, tracking, tip)
  local servo <close> = rig:servo { background = background, law = p.law, field = p.field, lost_timeout = 5 * s }
  servo:hold(center)
  servo:wait_until_tracked()
  local from = servo:position()
  local target = center + vector(p.way * (number % 2 == 1 and 1 or -1), 0, 0)
  local done, problem = go(rig, run, p, servo, target, tracking, tip)
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
    lamp = { default = "Leica CLS100", help = "which, and at which level: for the record" },
    clearing = {
      choices = { "none", "verografin", "glucose" },
      default = "none",
      help = "of the sclera, for light through it (7.4); its timer asks for it again",
    },
    tip = { default = "6,6,4", help = "x,y,z in mm, world, of the endoilluminator's magnetic tip" },
    tip_margin = {
      unit = "mm",
      default = 4 * mm,
      min = 1 * mm,
      max = 20 * mm,
      help = "how far the robot stays from it: a way that comes nearer is refused, a robot that does ends the run",
    },
    lens = { choices = { "biom", "vitrectomy_lens" }, default = "biom", help = "through which the retina is seen" },
    vitrectomy = {
      choices = { "auto", "yes", "no" },
      default = "auto",
      help = "auto: for a soft robot, which does not move in the vitreous; not for a permanent magnet",
    },
    dye = { choices = { "trypan_blue", "cortisone" }, default = "trypan_blue", help = "that shows the vitreous to be taken out" },
    alive = { default = false, help = "a living eye: trypan blue, which is toxic, is refused" },
    eye_id = { default = "", help = "the eye's, for the record" },
    age = { default = "", help = "of the animal" },
    died = { default = "", help = "when the animal died: 2026-11-24T05:40" },
    removed = { default = "", help = "when the eye was removed: 2026-11-24T06:10" },
    since_removal = {
      unit = "min",
      default = 30 * minute,
      min = 0,
      max = 600 * minute,
      help = "how long that is ago: of the three to four hours so much is gone",
    },
    pipette = { default = "24 G", help = "with which the robot is inserted" },
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
    tracked = { default = 150, min = 2, max = 10000, integer = true, help = "frames that are tracked while it moves, at most" },
  },
  run = function(rig, p, run)
    local list = checklist.new(run, rig, { window = published.porcine_window, gone = p.since_removal })
    local tip = tip_of(run, p)
    steps.describe(run, p)
    if p.optics ~= "removed" then -- else there is no cornea to keep wet
      local reminder = run:remind("moisturize the cornea: Lacrinorm gel (45° 23 G tip), or water", { every = p.moisten })
      run:defer(function() reminder:close() end)
    end
    run:progress(0, "preparing")
    steps.prepare(list, p)
    list:tell_time()
    steps.light(list, p)
    run:progress(0.2, "focusing")
    steps.focus(list, rig, run, p)
    list:tell_time()
    steps.vitrectomy(list, rig, run, p)
    run:progress(0.4, "inserting")
    rig.sample:remove_robot()
    local background = rig:learn_background { frames = 10 }
    local tracking = tracker_for(rig)
    list:must("everybody clear of the coils; the robot is in its pipette, " .. p.pipette, { name = "clear" })
    rig.sample:insert_robot(center)
    list:photograph("after insertion", { name = "photo_robot" })
    local rows, most = {}, 0
    for number in run:each(p.trials, "trial") do
      run:checkpoint("before trial " .. number)
      if list:tell_time() == false then break end
      steps.keep_clear(list, p)
      run:wait(0.2 * s) -- the next loop's currents must not follow the last one's at once
      local row, moved = trial(rig, run, p, background, number, tracking, tip)
      rows[number], most = row, math.max(most, moved)
    end
    run:table { title = "Motion trials", header = { "trial", "moved", "end" }, rows = rows }
    run:result("moved_most", most, "m")
    if tracking.frames > 0 then
      run:result("tracked_part", tracking.seen / tracking.frames)
      run:result("tracked_frames", tracking.frames)
      run:result("tracked_way_px", tracking.way)
    end
    if tip then run:result("tip_nearest", tip.nearest, "m") end
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
