-- Swimmers in a field that turns or oscillates: what law each robot wants, and the speed that a frequency gives, measured.
-- SPDX-License-Identifier: Apache-2.0
local control = require "control"
local units = require "units"
local swimming = {}

local s, Hz = units.s, units.Hz
local along = vector(1, 0, 0)

--- "helix" or "tail": how the robot of the rig swims. Raises for one that does not.
function swimming.kind(rig)
  local kind = rig:model().robot_moves_by
  if kind == "gradient" then
    error(("%s does not swim: wants a helix (rig helix) or a flexible tail (rig tail)"):format(rig:model().robot_name), 0)
  end
  return kind
end

--- m/s along +x in a span {from, to}: least squares of the seen position against time.
function swimming.speed(run, span)
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

--- Speed of a tail at a frequency: forwards along +x and along -x, of which the mean is taken, so that what pulls the robot
--- aside does not count. Returns the speed (m/s) and the frequency that the coils reached.
function swimming.beat(run, servo, frequency, measure)
  local speed, reached = 0, frequency
  for _, sense in ipairs { 1, -1 } do
    servo:spin { axis = along * sense, frequency = frequency }
    -- It turns round, and its tail comes to its beat.
    run:wait(1.5 * s)
    local span = { from = run:now() }
    run:wait(measure)
    span.to = run:now()
    speed = speed + sense * swimming.speed(run, span) / 2
    reached = math.min(reached, math.abs(servo:rotation().frequency))
  end
  return speed, reached
end

--- The curve that control.oscillating steers by: {frequencies, speeds}, of the frequencies in use. The first is near the best
--- of all machines; for less than its speed the law lowers the swing.
function swimming.curve(run, servo, measure)
  local curve = { frequencies = {}, speeds = {} }
  for k, frequency in ipairs { 9 * Hz, 12 * Hz } do
    curve.speeds[k], curve.frequencies[k] = swimming.beat(run, servo, frequency, measure)
    run:record("beat", { frequency = curve.frequencies[k], speed = curve.speeds[k] })
  end
  return curve
end

--- The law for a robot of `kind` with the fastest frequency and, of a tail, the curve (none: it is spun alone).
function swimming.law(kind, options, curve)
  if kind == "helix" then
    return control.rotating {
      mode = "helix",
      frequency = options.frequency,
      max_speed = options.max_speed,
      recover = options.recover,
    }
  end
  return control.oscillating {
    frequencies = curve and curve.frequencies,
    speeds = curve and curve.speeds,
    frequency = options.frequency,
    max_speed = options.max_speed,
  }
end

return swimming
