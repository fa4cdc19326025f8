-- Speed of a helical swimmer against the frequency of the field: a straight line up to the step-out, above it what is left of
-- the rotation. The advance per turn, and the step-out's frequency beside that of the model. For the rig scripts/rigs/helix.lua.
-- SPDX-License-Identifier: Apache-2.0
local control = require "control"
local units = require "units"
local mm, um, s, mT, Hz = units.mm, units.um, units.s, units.mT, units.Hz

local along = vector(1, 0, 0)

-- m/s, least squares of the position along the axis against time.
local function speed_of(run, span)
  local seen = run:samples("servo", { "x" }, span)
  local n, st, sx, stt, stx = 0, 0, 0, 0, 0
  for i, x in ipairs(seen.x) do
    if x == x then
      local t = seen.time[i] - span.from
      n, st, sx, stt, stx = n + 1, st + t, sx + x, stt + t * t, stx + t * x
    end
  end
  if n < 5 then error("the swimmer was seen in " .. n .. " frames only", 0) end
  return (n * stx - st * sx) / (n * stt - st * st)
end

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

return {
  title = "Speed of a swimmer over the field's frequency",
  needs = { "coils", "sample" },
  rig = "helix",
  parameters = {
    feedback = { choices = { "pose_sensor", "two_cameras", "one_camera" }, default = "pose_sensor", help = "of the loop" },
    field = { unit = "mT", default = 1 * mT, min = 1 * mT, max = 20 * mT, help = "magnitude of the rotating field" },
    lowest = { unit = "Hz", default = 2 * Hz, min = 0.5 * Hz, max = 50 * Hz, help = "first frequency" },
    highest = { unit = "Hz", default = 14 * Hz, min = 1 * Hz, max = 100 * Hz, help = "last frequency" },
    steps = { default = 9, min = 4, max = 100, integer = true, help = "frequencies, evenly between" },
    measure = { unit = "s", default = 1 * s, min = 0.5 * s, max = 10 * s, help = "how long each is measured" },
  },
  run = function(rig, p, run)
    local background
    rig.sample:remove_robot()
    if p.feedback ~= "pose_sensor" then background = rig:learn_background { frames = 15 } end
    local servo <close> = rig:servo {
      law = control.rotating { mode = "helix", frequency = p.highest, max_speed = 0.4 * mm / s, recover = false },
      feedback = p.feedback,
      background = background,
      field = p.field,
      lost_timeout = 3 * s,
    }
    local start = vector(-2 * mm, 0, 0)
    servo:hold(start)
    rig.sample:insert_robot(start)
    servo:wait_until_tracked()
    local believed = servo:rotation().believed_step_out
    local rows, limited = {}, 0
    for k in run:each(p.steps, "frequency") do
      local frequency = p.lowest + (p.highest - p.lowest) * (k - 1) / (p.steps - 1)
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
      rows[k] = { frequency = reached, speed = speed_of(run, span) }
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
  end,
}
