-- Calibrates the coils' field in the workspace by the robot's own motion, in seven minutes: with its axis along four directions
-- it goes through a box about the center, and what it did beside what the model let expect says how the coils' dipoles and the
-- background differ. A fifth direction is not fitted and judges the result. What is accepted goes into the rig's calibration
-- file: the field as octomag_by_motion.yaml, drag and moment as factors (docs/how-to/calibrate.md).
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "calibration.acceptance"
local bring = require "session.preparation"
local files = require "files"
local flights = require "calibration.field"
local limits = require "calibration.limits"
local units = require "units"
local mm, um, s, mT, deg = units.mm, units.um, units.s, units.mT, units.deg

local function pitched(pitch, azimuth)
  local p, a = pitch * deg, azimuth * deg
  return vector(math.cos(p) * math.cos(a), math.cos(p) * math.sin(a), math.sin(p))
end

-- Pitch and azimuth of the axis, degrees; the last is not fitted. Along y the side camera would see crossed plates from their
-- end, as a cross, and the loop would change from two cameras to one and back.
local axes = { { 0, 0 }, { 0, 45 }, { 0, -45 }, { 45, 0 }, { 0, 20 } }
local box = { x = 3 * mm, y = 2 * mm, heights = { 2 * mm, 0, -2 * mm } }
local file_name = "octomag_by_motion.yaml"

-- The motions, and the span of the one that judges. The field of one strength throughout: a soft robot's moment depends on it.
local function fly(rig, run, p, background)
  local motions, judged, points = {}, nil, flights.tour(box)
  local servo <close> = rig:servo {
    background = background,
    feedback = p.feedback,
    law = "estimator",
    axis = pitched(axes[1][1], axes[1][2]),
    field = p.field,
    field_max = p.field,
  }
  bring.insert(rig, servo, points[1])
  for k, angles in ipairs(axes) do
    local label = ("axis pitched by %d degrees, azimuth %d"):format(angles[1], angles[2])
    run:progress((k - 1) / #axes, label)
    motions[k], judged = flights.fly(run, servo, pitched(angles[1], angles[2]), points, { settle = p.settle, label = label })
  end
  motions[#axes].held_out = true
  return motions, judged
end

local function degrees(value) return ("%.2f"):format(value / deg) end
local function percent(value) return ("%.1f"):format(100 * value) end

-- Each coil as it differs; and which of them a motion did not tell.
local function show_coils(run, found)
  local rows, untold = {}, {}
  for k, coil in ipairs(found.coils) do
    rows[k] = {
      tostring(k),
      percent(coil.gain - 1),
      percent(coil.gain_sigma) .. " (" .. percent(coil.gain_believed) .. ")",
      degrees(coil.angle),
      degrees(coil.angle_sigma) .. " (" .. degrees(coil.angle_believed) .. ")",
    }
    if coil.gain_sigma > 0.8 * coil.gain_believed or coil.angle_sigma > 0.8 * coil.angle_believed then
      untold[#untold + 1] = tostring(k)
    end
  end
  run:table {
    title = "Each coil's field in the middle of the motion against the model; in brackets how well it was known before",
    header = { "coil", "stronger, %", "one sigma, %", "turned, °", "one sigma, °" },
    rows = rows,
  }
  if #untold > 0 then
    run:note(
      ("not told of coils %s by themselves: one of their numbers is known little better than before"):format(
        table.concat(untold, ", ")
      )
    )
  end
  run:note(
    "a motion shows the coils together, at currents as they are allocated: their combinations in use are known better than "
      .. "single coils. Gravity, drag and moment show as ratios alone, and the weight is taken as believed; outside of the box "
      .. "the robot was not"
  )
end

-- What the fit says, with its limits.
local function judge(run, p, found, before)
  local book = acceptance.new(run, "The field by the robot's motion")
  local held = found.held_out
  local well = book:check {
    name = "unexplained velocity, of the direction that was not fitted",
    part = "field",
    believed = held.before,
    value = held.after,
    unit = "m/s",
    least = 0,
    most = math.max(limits.by_motion.better * held.before, limits.by_motion.unexplained),
  }
  well = book:check {
    name = "background beyond the believed",
    part = "field",
    value = vector(found.background):norm(),
    unit = "T",
    least = 0,
    most = limits.background,
  } and well
  for k, coil in ipairs(found.coils) do
    well = book:check {
      name = ("coil %d: strength, over the believed"):format(k),
      part = "field",
      value = coil.gain,
      sigma = coil.gain_sigma,
      least = 1 - limits.by_motion.gain,
      most = 1 + limits.by_motion.gain,
    } and well
    well = book:check {
      name = ("coil %d: turned"):format(k),
      part = "field",
      value = coil.angle,
      sigma = coil.angle_sigma,
      unit = "rad",
      least = 0,
      most = limits.by_motion.angle,
    } and well
  end
  -- (1 + r) M F - (1 + s) M W with the weight as believed: less drag by the sink's factor, and the rest is the moment's.
  local factors = {
    { "drag across, over the believed", "model.drag_across", before.drag_across / found.sink, found.sink_sigma / found.sink },
    { "drag along, over the believed", "model.drag_along", before.drag_along / found.sink, found.sink_sigma / found.sink },
    {
      "moment, over the believed",
      "model.moment",
      before.moment * found.response / found.sink,
      math.sqrt((found.response_sigma / found.response) ^ 2 + (found.sink_sigma / found.sink) ^ 2),
    },
  }
  local were = { before.drag_across, before.drag_along, before.moment }
  for k, row in ipairs(factors) do
    well = book:check {
      name = row[1],
      key = row[2],
      part = "field",
      believed = were[k],
      value = row[3],
      sigma = row[3] * row[4],
      least = limits.robot.least,
      most = limits.robot.most,
    } and well
  end
  if well then book:keep("model.calibration", file_name) end
  return book
end

-- What is stated of the angle between the field and the model's, both coordinates of the direction together. Through cameras the
-- robot moves as their frame has it, which is turned against the world by what the rig's view says.
local function stated(sigma, tilt) return math.sqrt(2 * (sigma ^ 2 + tilt ^ 2)) end

local function report(run, found, directions, tilt)
  run:result("unexplained_before", found.held_out.before, "m/s")
  run:result("unexplained_after", found.held_out.after, "m/s")
  run:result("fitted_before", found.fitted.before, "m/s")
  run:result("fitted_after", found.fitted.after, "m/s")
  run:result("direction_sigma_before", stated(found.direction_believed, 0), "rad")
  run:result("direction_sigma_after", stated(found.direction_sigma, tilt), "rad")
  run:result("response", found.response)
  run:result("sink", found.sink)
  if not directions then
    run:note("the robot's axis was not measured: whether the field's direction is right was not judged")
    return
  end
  run:result("direction_error_before", directions.before, "rad")
  run:result("direction_error_after", directions.after, "rad")
end

return {
  title = "Calibration of the field by the robot's motion",
  needs = { "coils", "sample" },
  parameters = {
    feedback = {
      choices = { "pose_sensor", "two_cameras" },
      default = "pose_sensor",
      help = "what the loop sees the robot by; pose_sensor: the simulator's truth, late and noisy",
    },
    field = { unit = "mT", default = 15 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
    settle = { unit = "s", default = 5 * s, min = 1 * s, max = 60 * s, help = "before each flight" },
    noise = { unit = "um", default = 5 * um, min = 0.1 * um, max = 1 * mm, help = "of a measured coordinate" },
    unexplained = {
      unit = "um/s",
      default = 10 * um / s,
      min = 0.1 * um / s,
      max = 1 * mm / s,
      help = "velocity, over half a second, that is neither noise nor the coils': the view's errors of scale",
    },
  },
  run = function(rig, p, run)
    local model, background = rig:model(), nil
    rig.sample:remove_robot()
    if p.feedback ~= "pose_sensor" then background = rig:learn_background { frames = 15 } end
    local motions, span = fly(rig, run, p, background)
    run:progress(0.98, "least squares")
    local found = rig:identify_field { motions = motions, noise = p.noise, unexplained = p.unexplained }
    files.write(
      file_name,
      found.model:to_yaml { name = "OctoMag", low = { -10 * mm, -10 * mm, -10 * mm }, high = { 10 * mm, 10 * mm, 10 * mm } }
    )
    show_coils(run, found)
    local models = { before = found.believed, after = found.model }
    local tilt = p.feedback == "pose_sensor" and 0 or model.uncertainty.tilt
    report(run, found, flights.directions(run, models, span, model.command_delay), tilt)
    local book = judge(run, p, found, model.identified)
    if not book:close() then error("not all numbers were accepted", 0) end
  end,
}
