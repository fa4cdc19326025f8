-- Measurements of the robot by its own motion: steps along a direction, and falls with the coils off.
-- SPDX-License-Identifier: Apache-2.0
local control = require "control"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, s = units.mm, units.s
local robot = {}

local position = { "x", "y", "z" }
local commanded = { "commanded_x", "commanded_y", "commanded_z" }

--- Goes to and fro along `direction` about `center`, 0.4 mm to either side at 0.8 mm/s, `count` times; what
--- control.identify_response makes of it.
function robot.steps(run, servo, options)
  local reach, points = 0.4 * mm, { options.center }
  for k = 1, options.count or 12 do
    points[#points + 1] = options.center + (k % 2 == 0 and -reach or reach) * options.direction
  end
  points[#points + 1] = options.center
  local span = { from = run:now() }
  servo:follow(points, { speed = 0.8 * mm / s, acceleration = 20 * mm / s ^ 2, label = "to and fro" })
  run:wait(0.3 * s)
  span.to = run:now()
  return control.identify_response {
    measured = run:samples("servo", position, span),
    commanded = run:samples("estimate", commanded, span),
    direction = options.direction,
    lag = options.lag,
  }
end

--- Lets the robot fall `count` times for `duration`, and holds it in between; what control.identify_fall makes of it, and
--- `believed`: how fast it should have fallen there, m/s.
function robot.falls(run, servo, options)
  local falls, believed = {}, {}
  for k = 1, options.count or 5 do
    run:progress((k - 1) / (options.count or 5), ("fall %d"):format(k))
    servo:go_to(options.place, { within = 0.3 * mm, settle = 1 * s, timeout = 20 * s })
    run:wait(options.rest or 2.5 * s)
    local fell = servo:let_fall(options.duration)
    run:wait(0.5 * s)
    falls[k] = {
      off = fell.off,
      on = fell.on,
      measured = run:samples("servo", position, { from = fell.off - 0.45 * s, to = run:now() }),
    }
    -- without current the command is what the model lets it sink by
    for _, speed in ipairs(run:samples("estimate", { "commanded_z" }, { from = fell.off, to = fell.on - 1e-6 }).commanded_z) do
      believed[#believed + 1] = -speed
    end
  end
  local found = control.identify_fall { falls = falls, lag = options.lag }
  found.believed = statistics.mean(believed)
  return found
end

return robot
