-- Measures the loop's latency: the age of the cameras' frames at arrival, and by a step of current, measured by the field
-- probe, the delay and bandwidth of the coils (facts: 50 ms and 15 Hz; with 80 ms of the camera the loop's 130 ms).
-- Unattended, with acceptance limits.
-- SPDX-License-Identifier: Apache-2.0
local acceptance = require "calibration.acceptance"
local calibrations = require "calibration.measurements"
local limits = require "calibration.limits"
local statistics = require "analysis.statistics"
local units = require "units"
local ms, A = units.ms, units.A

return {
  title = "Calibration of the latency",
  needs = { "top_camera", "coils", "field_probe" },
  rig = "calibration",
  parameters = {
    coils = { default = 8, min = 1, max = 8, integer = true, help = "channels that are tried" },
    current = { unit = "A", default = 3 * A, min = 0.1 * A, max = 12 * A, help = "height of the step" },
    frames = { default = 30, min = 2, max = 1000, integer = true, help = "of which the age is taken" },
    limit = {
      unit = "ms",
      default = limits.delay,
      min = 1 * ms,
      max = 500 * ms,
      help = "by which the delay may differ from what is believed at the start",
    },
  },
  run = function(rig, p, run)
    local book, model = acceptance.new(run, "Latency"), rig:model()
    local delays, constants, curves = {}, {}, {}
    for coil in run:each(math.min(p.coils, #rig.coils:currents()), "coil") do
      run:checkpoint("before coil " .. coil)
      local step = calibrations.coil_latency(rig, run, { coil = coil, current = p.current })
      delays[coil], constants[coil] = step.delay, step.constant
      curves[coil] = { label = "coil " .. coil, x = step.times, y = step.values, mark = "points" }
      run:record("step", { coil = coil, delay = step.delay, constant = step.constant }, { delay = "s", constant = "s" }, {
        coil = "number of the coil, from 1",
        delay = "from the set-point to the first change of the field",
        constant = "time constant of the change",
      })
    end
    run:plot { title = "Field after a step of current", x = { "time", "s" }, y = { "field", "mT" }, series = curves }
    local delay, constant = statistics.median(delays), statistics.median(constants)
    limits.coil_latency(
      book,
      model,
      { delay = delay, constant = constant },
      { delay = p.limit, sigma = statistics.deviation(delays) }
    )
    for _, role in ipairs { "top_camera", "side_camera" } do
      if rig[role] then
        local age = calibrations.camera_latency(rig[role], p.frames)
        limits.frames(book, role, age)
        if role == "top_camera" then run:result("loop_latency", age.mean + delay, "s") end
      end
    end
    if not book:close() then error("not all numbers were accepted", 0) end
  end,
}
