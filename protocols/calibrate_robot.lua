-- Identifies the robot by its own motion, in two minutes: delay and response by steps along x and z, drag along and across its
-- axis by falls with the coils off, lying and pitched, which no field model is needed for. What is accepted goes into the rig's
-- calibration file (docs/how-to/calibrate.md). A motion shows ratios alone: the weight is taken as believed. Upright, crossed
-- plates show a camera above them a cross and no ellipse: the drag along the axis is calculated from a pitch of 60 degrees.
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "calibration.acceptance"
local bring = require "session.preparation"
local identify = require "calibration.robot"
local limits = require "calibration.limits"
local units = require "units"
local mm, s, ms, mT = units.mm, units.s, units.ms, units.mT

local place = vector(0, 0, 1 * mm)
local lying, upright = vector(1, 0, 0), vector(0, 0, 1)
local along_part = 0.75 -- sin^2 of the pitch: the part of the fall's mobility that is along the axis
local pitched = math.sqrt(1 - along_part) * lying + math.sqrt(along_part) * upright

-- With the same field throughout: a soft robot's moment depends on it.
local function open(rig, p, background, axis)
  return rig:servo {
    background = background,
    feedback = p.feedback,
    law = "estimator",
    axis = axis,
    field = p.field,
    field_max = p.field,
  }
end

local function percent(value) return ("%.1f %%"):format(100 * value) end

-- The fall along the axis from the falls pitched and lying: mobilities add up as sin^2 and cos^2 of the pitch.
local function along_of(fall, across)
  local function part(whole, other) return (whole - (1 - along_part) * other) / along_part end
  return {
    speed = part(fall.speed, across.speed),
    believed = part(fall.believed, across.believed),
    speed_sigma = math.sqrt(fall.speed_sigma ^ 2 + ((1 - along_part) * across.speed_sigma) ^ 2) / along_part,
  }
end

-- Two estimates of one number: their mean by their variances, and its sigma, which their difference widens.
local function both(a, sigma_a, b, sigma_b)
  local wa, wb = 1 / sigma_a ^ 2, 1 / sigma_b ^ 2
  local value = (wa * a + wb * b) / (wa + wb)
  return value, math.max(1 / math.sqrt(wa + wb), math.abs(a - b) / 2)
end

local function measure(rig, run, p, background, model)
  local lag = 1 / (2 * math.pi * model.command_bandwidth)
  -- A soft magnet's force goes with the current's square: it is gone in half the time.
  local force_lag = model.identified.hard and lag or lag / 2
  local found = {}
  do
    local servo <close> = open(rig, p, background, lying)
    bring.insert(rig, servo, place)
    servo:go_to(place, { within = 0.5 * mm, settle = 1 * s, timeout = 40 * s })
    run:wait(p.settle)
    run:progress(0.1, "steps along x")
    found.x = identify.steps(run, servo, { center = place, direction = lying, lag = lag })
    run:progress(0.25, "steps along z")
    found.z = identify.steps(run, servo, { center = place, direction = upright, lag = lag })
    run:progress(0.4, "falls, lying")
    found.across = identify.falls(run, servo, { place = place, duration = p.fall, count = p.falls, lag = force_lag })
  end
  rig.sample:remove_robot()
  run:wait(0.5 * s)
  do
    local servo <close> = open(rig, p, background, pitched)
    bring.insert(rig, servo, place)
    servo:go_to(place, { within = 0.5 * mm, settle = 1 * s, timeout = 40 * s })
    run:wait(p.settle)
    run:progress(0.7, "falls, pitched")
    local fell = identify.falls(run, servo, { place = place, duration = p.fall, count = p.falls, lag = force_lag })
    found.along = along_of(fell, found.across)
  end
  rig.sample:remove_robot()
  return found
end

-- The model's factors as they follow from ratios to what it said.
local function judge(run, p, found, model)
  local before, book = model.identified, acceptance.new(run, "The robot")
  -- A scale of the image that is wrong by this is a speed that is.
  local scale = 0.005
  local function sink(fall) return fall.speed / fall.believed, math.sqrt((fall.speed_sigma / fall.speed) ^ 2 + scale ^ 2) end
  local across, across_sigma = sink(found.across)
  local along, along_sigma = sink(found.along)
  local delay, delay_sigma = both(found.x.delay, found.x.delay_sigma, found.across.delay, found.across.delay_sigma)
  local moment, moment_sigma = both(
    found.x.gain / along,
    found.x.gain / along * math.sqrt((found.x.gain_sigma / found.x.gain) ^ 2 + along_sigma ^ 2),
    found.z.gain / across,
    found.z.gain / across * math.sqrt((found.z.gain_sigma / found.z.gain) ^ 2 + across_sigma ^ 2)
  )
  local rows = {
    { "drag across, over the believed", "model.drag_across", before.drag_across, before.drag_across / across, across_sigma },
    { "drag along, over the believed", "model.drag_along", before.drag_along, before.drag_along / along, along_sigma },
    { "moment, over the believed", "model.moment", before.moment, before.moment * moment, moment_sigma / moment },
  }
  for _, row in ipairs(rows) do
    book:check {
      name = row[1],
      key = row[2],
      part = "robot",
      believed = row[3],
      value = row[4],
      sigma = row[4] * row[5],
      least = limits.robot.least,
      most = limits.robot.most,
    }
    book:check {
      name = row[1] .. ": how well it is known",
      part = "robot",
      value = row[5],
      least = 0,
      most = limits.robot.sigma,
    }
  end
  book:check {
    name = "coils: delay, by the robot's motion",
    key = "model.coil_delay",
    part = "delay",
    believed = model.command_delay,
    value = delay,
    sigma = delay_sigma,
    unit = "s",
    least = model.command_delay - p.limit,
    most = model.command_delay + p.limit,
  }
  run:headline(("The robot follows a command after %s"):format(format_quantity(delay, "s")))
  run:result("delay", delay, "s")
  run:result("delay_x", found.x.delay, "s")
  run:result("delay_z", found.across.delay, "s")
  run:result("drag_across", rows[1][4])
  run:result("drag_along", rows[2][4])
  run:result("moment", rows[3][4])
  run:result("weight_over_moment", 1 / moment)
  run:result("response_x", found.x.gain)
  run:result("response_z", found.z.gain)
  return book
end

-- What a motion cannot tell, and what of this one was not seen well.
local function note_limits(run, found)
  run:note(
    "a motion shows ratios alone: weight over drag, moment over drag. The weight is taken as believed; where it is wrong by a "
      .. "part, drag and moment are wrong by the same part, and the loop is not"
  )
  run:note(
    (
      "the response was measured about one place, where the field's model is off by %s between x and z; elsewhere it is "
      .. "another"
    ):format(percent(math.abs(found.x.gain - found.z.gain)))
  )
  run:note("not told: the moment along another direction of the field, its saturation, and the drag in turning")
  for name, one in pairs { x = found.x, z = found.z } do
    if one.excitation < 10 * one.residual then
      run:note(("along %s the robot moved little beside what was not explained: its response is doubtful"):format(name))
    end
  end
end

return {
  title = "Identification of the robot",
  needs = { "coils", "sample" },
  parameters = {
    feedback = {
      choices = { "two_cameras", "one_camera", "pose_sensor" },
      default = "two_cameras",
      help = "what the loop sees the robot by; pose_sensor: the simulator's truth, late and noisy",
    },
    falls = { default = 5, min = 2, max = 20, integer = true, help = "of either attitude" },
    fall = {
      unit = "s",
      default = 0.5 * s,
      min = 0.2 * s,
      max = 1 * s,
      help = "how long the coils are off; a heavy robot wants less",
    },
    settle = { unit = "s", default = 5 * s, min = 1 * s, max = 60 * s, help = "before it is measured" },
    limit = {
      unit = "ms",
      default = 60 * ms,
      min = 1 * ms,
      max = 200 * ms,
      help = "by which the delay may differ from the believed",
    },
    field = { unit = "mT", default = 10 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
  },
  run = function(rig, p, run)
    local model, background = rig:model(), nil
    rig.sample:remove_robot()
    if p.feedback ~= "pose_sensor" then background = rig:learn_background { frames = 15 } end
    local found = measure(rig, run, p, background, model)
    local book = judge(run, p, found, model)
    note_limits(run, found)
    if not book:close() then error("not all numbers were accepted", 0) end
  end,
}
