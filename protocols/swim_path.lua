-- A helical swimmer along a path of a centimeter in a rotating field whose axis steers it, and then a field that turns too fast
-- for it: how soon the step-out is told, and whether the law finds back below it. Judged by the simulator's truth or, in a
-- laboratory, by the side camera. For the rig scripts/rigs/helix.lua.
-- SPDX-License-Identifier: Apache-2.0
local control = require "control"
local units = require "units"
local judge = require "analysis.path_accuracy"
local mm, um, s, mT, Hz = units.mm, units.um, units.s, units.mT, units.Hz

-- 10.4 mm, bent in both directions and climbing both ways.
local points = {
  vector(-4 * mm, 0, 0),
  vector(-1.5 * mm, 1 * mm, 0.7 * mm),
  vector(1.5 * mm, -1 * mm, -0.5 * mm),
  vector(4.5 * mm, 0.5 * mm, 0.5 * mm),
}

local function open(rig, p, field, background)
  return rig:servo {
    law = control.rotating { mode = "helix", frequency = p.frequency },
    feedback = p.feedback,
    background = background,
    field = field,
    lost_timeout = 3 * s,
  }
end

local function follow(rig, run, p, background)
  local servo <close> = open(rig, p, p.field, background)
  servo:hold(points[1])
  rig.sample:insert_robot(points[1])
  servo:wait_until_tracked()
  servo:go_to(points[1], { within = 0.3 * mm, settle = p.settle, timeout = 60 * s })
  local path = control.spline { points = points, speed = p.speed, acceleration = p.acceleration }
  local span = { from = run:now() }
  servo:follow(path, { label = "along the path", progress_to = 0.6 })
  span.to = run:now()
  local found = judge.results(run, span)
  run:result("path_length", path:info().length, "m")
  local rotation = run:samples("rotation", { "frequency", "response" }, span)
  local distance = judge.distances(run, span, "target_")
  run:plot {
    title = "Distance from the path's point",
    x = { "time", "s" },
    y = { "distance in 3-D", "um" },
    series = { { label = "swimmer", x = distance.x, y = distance.y } },
  }
  run:plot {
    title = "Frequency of the field",
    x = { "time", "s" },
    y = { "frequency", "Hz" },
    series = { { label = "commanded", x = rotation.time, y = rotation.frequency } },
  }
  servo:close()
  rig.sample:remove_robot()
  return found
end

-- Time from the moment at which the field turned faster than the robot can to the moment at which the loop says so.
local function overrun(rig, run, p, background)
  local servo <close> = open(rig, p, p.weak_field, background)
  servo:hold(points[1])
  rig.sample:insert_robot(points[1])
  servo:wait_until_tracked()
  servo:go_to(points[1], { within = 0.5 * mm, settle = 0.5 * s, timeout = 60 * s })
  local believed = servo:rotation().believed_step_out
  servo:spin { axis = { 1, 0, 0 }, frequency = 0.6 * believed }
  run:wait(1.5 * s)
  local begin = run:now()
  servo:spin { axis = { 1, 0, 0 }, frequency = 1.25 * believed }
  local told
  while not told and run:now() < begin + 3 * s do
    run:wait(0.05 * s)
    if servo:rotation().step_out then told = run:now() - begin end
  end
  if not told then
    run:note "no step-out within 3 s at 1.25 of the model's: this robot turns faster, or the coils turn the field more slowly"
    return
  end
  local found = servo:rotation().step_out
  run:wait(1.5 * s)
  local after = servo:rotation()
  run:result("step_out_told_after", told, "s")
  run:result("step_out_found", found, "Hz")
  run:result("step_out_believed", believed, "Hz")
  run:result("response_after_recovery", after.response / after.response_before)
  run:table {
    title = "A field that turns too fast: " .. ("%.1f Hz"):format(1.25 * believed / Hz),
    header = { "what", "value" },
    rows = {
      { "told after, s", ("%.2f"):format(told) },
      { "step-out as the speed tells it, Hz", ("%.2f"):format(found) },
      { "step-out by the model, Hz", ("%.2f"):format(believed) },
      { "frequency afterwards, Hz", ("%.2f"):format(after.frequency) },
      { "way per turn afterwards, part of that before", ("%.2f"):format(after.response / after.response_before) },
    },
  }
end

return {
  title = "A helical swimmer along a path",
  needs = { "coils", "sample" },
  rig = "helix",
  parameters = {
    feedback = { choices = { "pose_sensor", "two_cameras", "one_camera" }, default = "pose_sensor", help = "of the loop" },
    field = { unit = "mT", default = 2 * mT, min = 1 * mT, max = 20 * mT, help = "magnitude of the rotating field" },
    weak_field = { unit = "mT", default = 1 * mT, min = 1 * mT, max = 20 * mT, help = "the same for the step-out" },
    frequency = { unit = "Hz", default = 14 * Hz, min = 1 * Hz, max = 100 * Hz, help = "the fastest" },
    speed = { unit = "mm/s", default = 1 * mm / s, min = 0.1 * mm / s, max = 3 * mm / s, help = "along the path" },
    acceleration = { default = 0.5 * mm, min = 0.05 * mm, max = 5 * mm, help = "along and across the path, m/s^2" },
    settle = { unit = "s", default = 3 * s, min = 0.5 * s, max = 60 * s, help = "at the path's begin" },
  },
  run = function(rig, p, run)
    local background
    rig.sample:remove_robot()
    if p.feedback ~= "pose_sensor" then background = rig:learn_background { frames = 15 } end
    local found = follow(rig, run, p, background)
    run:table {
      title = "Along the path",
      header = { "what", "value" },
      rows = {
        { "distance from the path's point, rms, µm", ("%.1f"):format(found.path.rms / um) },
        { "the same, largest, µm", ("%.1f"):format(found.path.max / um) },
      },
    }
    run:checkpoint("before the step-out")
    overrun(rig, run, p, background)
  end,
}
