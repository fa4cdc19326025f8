-- Speed of a helical swimmer against the frequency of the field: a straight line up to the step-out, above it what is left of
-- the rotation. The advance per turn, and the step-out's frequency beside that of the model. Of a swimmer with a flexible tail:
-- the speed over the frequency of a field that oscillates, and the best one. For the rigs scripts/rigs/helix.lua and tail.lua.
-- SPDX-License-Identifier: Apache-2.0
local swimming = require "session.swimming"
local units = require "units"
local mm, um, s, mT, Hz = units.mm, units.um, units.s, units.mT, units.Hz

local along = vector(1, 0, 0)

-- Speed over frequency of a swimmer that advances by `advance` (m) a turn.
local function model_speed(advance, step_out, frequency)
  if frequency <= step_out then return advance * frequency end
  return advance * (frequency - math.sqrt(frequency ^ 2 - step_out ^ 2))
end

-- The step-out that fits best, by least squares over a fine ladder; the advance is that of the slower half.
local function fit(rows)
  local advance, count = 0, 0
  for _, row in ipairs(rows) do
    if row.frequency < 0.5 * rows[#rows].frequency then
      advance, count = advance + row.speed / row.frequency, count + 1
    end
  end
  if count == 0 then error("no frequency below half of the highest", 0) end
  advance = advance / count
  local best, at = math.huge, nil
  for step_out = 0.2 * rows[#rows].frequency, 1.5 * rows[#rows].frequency, 0.01 do
    local sum = 0
    for _, row in ipairs(rows) do
      sum = sum + (row.speed - model_speed(advance, step_out, row.frequency)) ^ 2
    end
    if sum < best then
      best, at = sum, step_out
    end
  end
  return advance, at, math.sqrt(best / #rows)
end

local function opened(rig, p, background, kind, field)
  return rig:servo {
    law = swimming.law(kind, { frequency = p.highest, max_speed = 0.4 * mm / s, recover = false }),
    feedback = p.feedback,
    background = background,
    field = p.field > 0 and p.field or field,
    lost_timeout = 3 * s,
  }
end

local function begin(rig, servo, start)
  servo:hold(start)
  rig.sample:insert_robot(start)
  servo:wait_until_tracked()
end

local function frequency_of(p, k) return p.lowest + (p.highest - p.lowest) * (k - 1) / (p.steps - 1) end

-- There is no step-out to be fitted: the higher the frequency, the less the head turns and the less of its tail beats.
local function of_a_tail(rig, run, p, background)
  local servo <close> = opened(rig, p, background, "tail", 10 * mT)
  begin(rig, servo, vector(0, 0, 0))
  local x, y, cells, best = {}, {}, {}, 1
  for k in run:each(p.steps, "frequency") do
    y[k], x[k] = swimming.beat(run, servo, frequency_of(p, k), p.measure)
    run:record("swim", { frequency = x[k], speed = y[k] })
    cells[k] = { ("%.2f"):format(x[k] / Hz), ("%.0f"):format(y[k] / (um / s)) }
    if y[k] > y[best] then best = k end
  end
  run:result("best_frequency", x[best], "Hz")
  run:result("best_speed", y[best], "m/s")
  run:table {
    title = ("Speed over frequency: %.0f µm/s at most, at %.2f Hz"):format(y[best] / (um / s), x[best] / Hz),
    header = { "frequency, Hz", "speed, µm/s" },
    rows = cells,
  }
  run:plot {
    title = "Speed over frequency",
    x = { "frequency", "Hz" },
    y = { "speed", "um/s" },
    series = { { label = "measured, mean of both ways", x = x, y = y, mark = "points" } },
  }
end

local function of_a_helix(rig, run, p, background)
  local servo <close> = opened(rig, p, background, "helix", 1 * mT)
  local start = vector(-2 * mm, 0, 0)
  begin(rig, servo, start)
  local believed = servo:rotation().believed_step_out
  local rows, limited = {}, 0
  for k in run:each(p.steps, "frequency") do
    local frequency = frequency_of(p, k)
    servo:go_to(start, { within = 0.5 * mm, settle = 0, speed = 0.6 * mm / s, timeout = 60 * s })
    -- Into the axis first, in step, then to the frequency.
    servo:spin { axis = along, frequency = math.min(frequency, 0.4 * believed) }
    run:wait(1 * s)
    servo:spin { axis = along, frequency = frequency }
    run:wait(0.4 * s)
    local span = { from = run:now() }
    run:wait(p.measure)
    span.to = run:now()
    local reached = math.abs(servo:rotation().frequency)
    if reached < 0.999 * frequency then limited = limited + 1 end
    rows[k] = { frequency = reached, speed = swimming.speed(run, span) }
    run:record("swim", { frequency = reached, speed = rows[k].speed })
  end
  if limited > 0 then
    run:note(("%d frequencies are above what coils and amplifier can turn, and were lowered"):format(limited))
  end
  local advance, step_out, misfit = fit(rows)
  run:result("advance_per_turn", advance, "m")
  run:result("step_out", step_out, "Hz")
  run:result("step_out_believed", believed, "Hz")
  run:result("curve_misfit_rms", misfit, "m/s")
  local x, y, line_x, line_y, theory_x, theory_y, cells = {}, {}, {}, {}, {}, {}, {}
  for k, row in ipairs(rows) do
    x[k], y[k] = row.frequency, row.speed
    local fitted = model_speed(advance, step_out, row.frequency)
    cells[k] = {
      ("%.2f"):format(row.frequency / Hz),
      ("%.0f"):format(row.speed / (um / s)),
      ("%.0f"):format(fitted / (um / s)),
    }
  end
  for k = 0, 100 do
    local frequency = p.highest * k / 100
    line_x[k + 1], line_y[k + 1] = frequency, model_speed(advance, step_out, frequency)
    theory_x[k + 1], theory_y[k + 1] = frequency, model_speed(advance, believed, frequency)
  end
  run:table {
    title = ("Speed over frequency: %.0f µm a turn, step-out at %.2f Hz (model: %.2f Hz)"):format(
      advance / um,
      step_out / Hz,
      believed / Hz
    ),
    header = { "frequency, Hz", "speed, µm/s", "fitted, µm/s" },
    rows = cells,
  }
  run:plot {
    title = "Speed over frequency",
    x = { "frequency", "Hz" },
    y = { "speed", "um/s" },
    series = {
      { label = "measured", x = x, y = y, mark = "points" },
      { label = "fitted", x = line_x, y = line_y },
      { label = "step-out by the model", x = theory_x, y = theory_y, mark = "dashed" },
    },
  }
end

return {
  title = "Speed of a swimmer over the field's frequency",
  needs = { "coils", "sample" },
  rig = "helix",
  parameters = {
    feedback = { choices = { "pose_sensor", "two_cameras", "one_camera" }, default = "pose_sensor", help = "of the loop" },
    field = { unit = "mT", default = 0, min = 0, max = 20 * mT, help = "its magnitude; 0: 1 mT of a helix, 10 mT of a tail" },
    lowest = { unit = "Hz", default = 2 * Hz, min = 0.5 * Hz, max = 50 * Hz, help = "first frequency" },
    highest = { unit = "Hz", default = 14 * Hz, min = 1 * Hz, max = 100 * Hz, help = "last frequency" },
    steps = { default = 9, min = 4, max = 100, integer = true, help = "frequencies, evenly between" },
    measure = { unit = "s", default = 1 * s, min = 0.5 * s, max = 10 * s, help = "how long each is measured" },
  },
  run = function(rig, p, run)
    local background
    rig.sample:remove_robot()
    if p.feedback ~= "pose_sensor" then background = rig:learn_background { frames = 15 } end
    local kind = swimming.kind(rig)
    if kind == "tail" then return of_a_tail(rig, run, p, background) end
    of_a_helix(rig, run, p, background)
  end,
}
