-- A helical swimmer along a path of a centimeter in a rotating field whose axis steers it, and then a field that turns too fast
-- for it: how soon the step-out is told, and whether the law finds back below it. A swimmer with a flexible tail goes along the
-- same path in a field that oscillates, by the speeds that are measured first; it has no step-out. Judged by the simulator's
-- truth or, in a laboratory, by the side camera. For the rigs scripts/rigs/helix.lua and tail.lua.
-- SPDX-License-Identifier: Apache-2.0
local control = require "control"
local units = require "units"
local judge = require "analysis.path_accuracy"
local swimming = require "session.swimming"
local mm, um, s, mT, Hz = units.mm, units.um, units.s, units.mT, units.Hz

-- 10.4 mm, bent in both directions and climbing both ways.
local points = {
  vector(-4 * mm, 0, 0),
  vector(-1.5 * mm, 1 * mm, 0.7 * mm),
  vector(1.5 * mm, -1 * mm, -0.5 * mm),
  vector(4.5 * mm, 0.5 * mm, 0.5 * mm),
}

-- What a parameter of 0 stands for.
local usual = {
  helix = { field = 2 * mT, speed = 1 * mm / s, acceleration = 0.5 * mm, settle = 3 * s },
  -- It is slow, and its tail wants a field that its head follows against the fluid.
  tail = { field = 10 * mT, speed = 0.06 * mm / s, acceleration = 0.01 * mm, settle = 15 * s },
}

local function open(rig, p, background, field, curve)
  return rig:servo {
    law = swimming.law(swimming.kind(rig), { frequency = p.frequency }, curve),
    feedback = p.feedback,
    background = background,
    field = field,
    lost_timeout = 3 * s,
  }
end

-- The tail's own speeds; the field that it is steered in is the same.
local function measured_curve(rig, run, p, background, field)
  local servo <close> = open(rig, p, background, field)
  servo:hold(vector(0, 0, 0))
  rig.sample:insert_robot(vector(0, 0, 0))
  servo:wait_until_tracked()
  local curve = swimming.curve(run, servo, 2 * s)
  servo:close()
  rig.sample:remove_robot()
  local rows = {}
  for k, speed in ipairs(curve.speeds) do
    rows[k] = { ("%.1f"):format(curve.frequencies[k] / Hz), ("%.0f"):format(speed / (um / s)) }
  end
  run:table { title = "Speed over frequency, as the law has it", header = { "frequency, Hz", "speed, µm/s" }, rows = rows }
  return curve
end

local function follow(rig, run, p, background)
  local its = {}
  for name, value in pairs(usual[swimming.kind(rig)]) do
    its[name] = p[name] > 0 and p[name] or value
  end
  local curve = swimming.kind(rig) == "tail" and measured_curve(rig, run, p, background, its.field) or nil
  local servo <close> = open(rig, p, background, its.field, curve)
  servo:hold(points[1])
  rig.sample:insert_robot(points[1])
  servo:wait_until_tracked()
  servo:go_to(points[1], { within = 0.3 * mm, settle = its.settle, timeout = 60 * s })
  local path = control.spline { points = points, speed = its.speed, acceleration = its.acceleration }
  local span = { from = run:now() }
  servo:follow(path, { label = "along the path", progress_to = 0.6 })
  span.to = run:now()
  local found = judge.results(run, span)
  found.mean_way = judge.mean_way(run, span, 1 * s)
  run:result("path_error_mean_way_rms", found.mean_way, "m")
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
  local servo <close> = open(rig, p, background, p.weak_field)
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
  title = "A swimmer along a path",
  needs = { "coils", "sample" },
  rig = "helix",
  parameters = {
    feedback = { choices = { "pose_sensor", "two_cameras", "one_camera" }, default = "pose_sensor", help = "of the loop" },
    field = { unit = "mT", default = 0, min = 0, max = 20 * mT, help = "its magnitude; 0: 2 mT of a helix, 10 mT of a tail" },
    weak_field = { unit = "mT", default = 1 * mT, min = 1 * mT, max = 20 * mT, help = "a helix' for the step-out" },
    frequency = { unit = "Hz", default = 14 * Hz, min = 1 * Hz, max = 100 * Hz, help = "the fastest" },
    speed = { unit = "mm/s", default = 0, min = 0, max = 3 * mm / s, help = "along the path; 0: 1 mm/s, 0.06 of a tail" },
    acceleration = { default = 0, min = 0, max = 5 * mm, help = "along and across it, m/s^2; 0: 0.5 mm/s^2, 0.01 of a tail" },
    settle = { unit = "s", default = 0, min = 0, max = 60 * s, help = "at the path's begin; 0: 3 s, 15 of a tail" },
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
        { "the same of the mean place over a second, rms, µm", ("%.1f"):format(found.mean_way / um) },
      },
    }
    if swimming.kind(rig) == "tail" then
      run:note(
        "a tail's beat swings the body to both sides by some 60 µm rms at full swing, which no loop takes away and which the "
          .. "first figure has in it; the mean over a second, several beats, is what the loop is off by"
      )
      return
    end
    run:checkpoint("before the step-out")
    overrun(rig, run, p, background)
  end,
}
