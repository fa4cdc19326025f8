-- Drift of the uncontrolled robot over three seconds at six places: with constant currents, with the field computed at the
-- position from one camera or two (thesis 6.1, table 6.1); and the drift that a loop which also holds the position leaves. On
-- a simulated rig medians over several machines, sampled as the machine itself is (facts of the drift study).
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local places = require "places"
local drift = require "analysis.drift"
local statistics = require "analysis.statistics"
local bring = require "session.preparation"
local retina = require "calibration.retina"
local free = require "session.free_drift"
local plant = require "session.plant"
local mm, um, s, mT = units.mm, units.um, units.s, units.mT

local kinds = { "none", "one_camera", "two_cameras" }
local names = drift.names
local center = vector(0, 0, 0)

-- The runs of one kind of feedback at all places; the median of a machine's mean drift is what counts.
local function leave_alone(run, rig, p, background, kind, found)
  local servo <close> = rig:servo {
    background = background,
    feedback = kind,
    field = p.field,
    lost_timeout = 5 * s,
    view = found.view,
    axis_uncertainty = kind ~= "two_cameras" and kind ~= "pose_sensor" and bring.axis_uncertainty(p.attitude) or nil,
  }
  servo:hold(center)
  rig.sample:insert_robot(center)
  servo:wait_until_tracked()
  found.trim = found.trim or free.trim(servo, p.tolerance)
  servo:set_trim(found.trim)
  for place in run:each(found.six, names[kind]) do
    run:checkpoint("before " .. place.name)
    local speeds = {}
    for repetition = 1, p.repetitions do
      free.bring(run, rig, servo, place, {
        scatter = kind == "none" and p.scatter_open or p.scatter,
        allowed = function(near) return places.in_sight(near, p.edge + 0.5 * mm) end,
      })
      local velocity = free.watch(run, function() servo:release() end, p.hold)
      speeds[repetition] = velocity:norm()
      run:record(
        "drift",
        { machine = found.machine, feedback = drift.index(kinds, kind), velocity = velocity },
        { velocity = "m/s" },
        {
          machine = "number of the machine, from 0",
          feedback = "number of the feedback among those that are compared, from 1",
          velocity = "mean velocity of the drift, world axes",
        }
      )
    end
    drift.add(found, kind, place.name, statistics.mean(speeds))
  end
  rig.sample:remove_robot()
end

-- The estimator: with its place held, and with what pushes it canceled but its place left alone.
local function hold_on(run, rig, p, background, found)
  local alone = p.feedback == "pose_sensor" or p.feedback == "two_cameras"
  local servo <close> = rig:servo {
    background = background,
    feedback = alone and p.feedback or "one_camera",
    law = "estimator",
    field = p.field,
    view = found.view,
  }
  servo:hold(center)
  rig.sample:insert_robot(center)
  servo:wait_until_tracked()
  for place in run:each(found.six, "estimator") do
    servo:go_to(place.position, { speed = free.hand_speed, within = 0.5 * mm, settle = 0 })
    run:wait(p.settle)
    drift.add(found, "hold", place.name, drift.velocity(run, p.hold):norm())
    local function cancel() servo:release { cancel = true } end
    drift.add(found, "cancel", place.name, free.watch(run, cancel, p.hold):norm())
  end
  rig.sample:remove_robot()
end

return {
  title = "Magnetic drift",
  needs = { "coils", "sample" },
  parameters = {
    feedback = {
      choices = { "all", "none", "one_camera", "two_cameras", "pose_sensor" },
      default = "all",
      help = "what the field follows; all: the thesis' three; pose_sensor: the simulator's truth, late and noisy",
    },
    attitude = {
      choices = { "estimated", "taken" },
      default = "estimated",
      help = "how the robot lies, by one camera; taken: along the commanded field, as the thesis; coils turn it by 0.15 rad",
    },
    machines = { default = 8, min = 1, max = 100, integer = true, help = "drawn, on a simulated rig; the first is the rig's" },
    edge = {
      unit = "mm",
      default = 4 * mm,
      min = 1 * mm,
      max = 8 * mm,
      help = "how far aside the three places at the right are",
    },
    repetitions = { default = 5, min = 1, max = 100, integer = true, help = "runs at each place" },
    hold = { unit = "s", default = 3 * s, min = 0.5 * s, max = 60 * s, help = "how long it is left alone" },
    settle = { unit = "s", default = 3 * s, min = 0.5 * s, max = 60 * s, help = "of the estimator, before its hold" },
    tolerance = {
      unit = "um/s",
      default = 100 * um / s,
      min = 0,
      max = 1000 * um / s,
      help = "drift that the trim leaves at the center",
    },
    scatter_open = { unit = "mm", default = 1 * mm, min = 0, max = 2 * mm, help = "of the placement, with constant currents" },
    scatter = { unit = "mm", default = 0.3 * mm, min = 0, max = 2 * mm, help = "of the placement, with feedback" },
    calibrate = retina.parameter "when",
    calibration = { default = "", help = "YAML of a measured machine, put in the simulated plant; empty: machines are drawn" },
    field = { unit = "mT", default = 10 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
  },
  run = function(rig, p, run)
    local asked = p.feedback == "all" and kinds or { p.feedback }
    if p.feedback ~= "pose_sensor" and not rig.top_camera then
      error("feedback: this rig has no top camera; feedback=pose_sensor does without", 0)
    end
    local machines = rig.simulation and p.machines or 1
    plant.calibrate(rig, run, p.calibration)
    rig.sample:remove_robot()
    local background = p.feedback ~= "pose_sensor" and rig:learn_background { frames = 15 } or nil
    local found = { six = places.six(p.edge, retina.room(rig).z) }
    for machine in run:each(machines, "machine") do
      if rig.simulation then rig.simulation:sample_machine(machine - 1) end
      found.trim, found.machine = nil, machine
      if p.feedback ~= "pose_sensor" and retina.wanted(rig, run, p.calibrate) then
        found.view = retina.view(rig, run, background, { field = p.field })
      end
      for kind in run:each(asked, "feedback") do
        leave_alone(run, rig, p, background, kind, found)
      end
      hold_on(run, rig, p, background, found)
    end
    drift.report(run, found, asked, { machines = machines, repetitions = p.repetitions })
  end,
}
