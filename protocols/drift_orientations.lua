-- The worst drift over the robot's orientations, in the center and at the boundary of the workspace, with constant currents and
-- with the field computed at the robot's position: the six numbers of Kummer 2010 that thesis 6.1 quotes. Without optics: a
-- pose sensor sees the robot (rigs open_vessel and open_vessel_ni).
-- SPDX-License-Identifier: Apache-2.0
local expect = require "analysis.expectations"
local free = require "session.free_drift"
local published = require "analysis.published"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, um, s, mT = units.mm, units.um, units.s, units.mT

local center = vector(0, 0, 0)
local ways = { "none", "pose_sensor" }
local way_names = { none = "constant currents", pose_sensor = "position feedback" }
local where_names = { center = "center", boundary = "boundary" }

local orientations = {
  { name = "x", axis = { 1, 0, 0 } },
  { name = "y", axis = { 0, 1, 0 } },
  { name = "z", axis = { 0, 0, 1 } },
  { name = "xy", axis = { 1, 1, 0 } },
  { name = "xz", axis = { 1, 0, 1 } },
}

-- The center, and the boundary at both sides along x and y and below; above is the lens of the cavity.
local function places_at(boundary)
  return {
    { name = "center", where = "center", position = center },
    { name = "right", where = "boundary", position = vector(boundary, 0, 0) },
    { name = "left", where = "boundary", position = vector(-boundary, 0, 0) },
    { name = "back", where = "boundary", position = vector(0, boundary, 0) },
    { name = "lower", where = "boundary", position = vector(0, 0, -boundary) },
  }
end

-- Speed under the currents that the model has for where the robot is, whatever it does then; refreshed, or the coils'
-- dead-man would end them.
local function under_constant_currents(run, rig, servo, time)
  servo:release() -- without what the position's controller adds
  run:wait(0.15 * s)
  local currents, speed = rig.coils:currents(), nil
  servo:close()
  for part = 0.1, 1, 0.1 do -- the interlock's rate of change
    rig.coils:set_currents(statistics.map(currents, function(current) return part * current end))
    run:wait(1e-3 * s)
  end
  run:together(function()
    while not speed do
      rig.coils:set_currents(currents)
      run:wait(0.02 * s)
    end
  end, function()
    speed = free.watch(run, function() end, time):norm()
  end)
  rig.coils:set_currents(statistics.map(currents, function() return 0 end))
  return speed
end

-- One attempt: brought to the place, let go, watched.
local function speed_at(run, rig, p, axis, trim, place, way)
  local servo <close> = rig:servo { feedback = "pose_sensor", field = p.field, axis = axis, lost_timeout = 5 * s }
  servo:hold(center)
  rig.sample:insert_robot(center)
  servo:wait_until_tracked()
  servo:set_trim(trim or free.trim(servo, p.tolerance, p.speed))
  trim = servo:status().trim
  free.bring(run, rig, servo, place, { scatter = 0, speed = p.speed })
  local speed
  if way == "none" then
    speed = under_constant_currents(run, rig, servo, p.hold)
  else
    speed = free.watch(run, function() servo:release() end, p.hold):norm()
  end
  rig.sample:remove_robot()
  run:wait(0.2 * s) -- until the currents are gone: they would throw the next robot
  return { speed = speed, trim = trim }
end

-- Speeds of one orientation on one machine, put into found[way][where]. A machine is trimmed once, in its first orientation.
local function leave_alone(run, rig, p, machine, number, found)
  for _, place in ipairs(places_at(p.boundary)) do
    for number_of_way, way in ipairs(ways) do
      run:checkpoint(("before %s, %s"):format(place.name, way_names[way]))
      local one = speed_at(run, rig, p, orientations[number].axis, found.trim, place, way)
      found.trim = one.trim
      table.insert(found[way][place.where], one.speed)
      run:record(
        "drift",
        { machine = machine, orientation = number, feedback = number_of_way, speed = one.speed },
        { speed = "m/s" },
        {
          machine = "number of the machine, from 1",
          orientation = "of the robot: 1 x, 2 y, 3 z, 4 between x and y, 5 between x and z",
          feedback = "1: constant currents, 2: the field follows the position",
          speed = "mean speed of the drift",
        }
      )
    end
  end
end

local function report(run, robot, worst)
  local kummer, rows = published.kummer_2010[robot], {}
  local book = expect.book(run, "Kummer 2010")
  for _, where in ipairs { "center", "boundary" } do
    for _, way in ipairs(ways) do
      local speeds, printed = worst[way][where], kummer and kummer[where .. "_" .. way]
      rows[#rows + 1] = {
        where_names[where],
        way_names[way],
        format_quantity(statistics.median(speeds), "m/s"),
        format_quantity(statistics.min(speeds), "m/s"),
        format_quantity(statistics.max(speeds), "m/s"),
        printed and format_quantity(printed, "m/s") or "–",
      }
      run:result(("worst_%s_%s"):format(where, way), statistics.median(speeds), "m/s")
      if printed then
        book:number {
          id = ("6.1.kummer.%s.%s.%s"):format(robot, where, way),
          what = ("worst drift over orientations, %s, %s, %s"):format(robot, where_names[where], way_names[way]),
          thesis = printed,
          ours = statistics.median(speeds),
          unit = "m/s",
          within = 5 * um / s,
          reason = "half of its last digit",
          why = ("machines from %s to %s; oil, field and how far out are not told with the numbers"):format(
            format_quantity(statistics.min(speeds), "m/s"),
            format_quantity(statistics.max(speeds), "m/s")
          ),
        }
      end
    end
  end
  run:table {
    title = "Worst drift over orientations and places, " .. robot,
    header = { "where", "currents", "median machine", "least", "most", "Kummer 2010" },
    rows = rows,
  }
  book:close()
end

return {
  title = "Drift over orientations",
  needs = { "coils", "sample" },
  rig = "open_vessel",
  simulated_only = true,
  parameters = {
    machines = { default = 5, min = 1, max = 100, integer = true, help = "drawn; the first is the rig's" },
    orientations = { default = 5, min = 1, max = 5, integer = true, help = "x, y, z, between x and y, between x and z" },
    boundary = { unit = "mm", default = 9.5 * mm, min = 1 * mm, max = 10 * mm, help = "how far out the workspace ends" },
    hold = { unit = "s", default = 3 * s, min = 0.5 * s, max = 60 * s, help = "how long it is left alone" },
    speed = {
      unit = "mm/s",
      default = 1.5 * mm / s,
      min = 0.05 * mm / s,
      max = 3 * mm / s,
      help = "on the way to a place; the Ni robot's force in oil is good for 0.2 mm/s",
    },
    tolerance = {
      unit = "um/s",
      default = 100 * um / s,
      min = 0,
      max = 1000 * um / s,
      help = "drift that the trim leaves at the center",
    },
    field = { unit = "mT", default = 10 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
  },
  run = function(rig, p, run)
    local worst = { none = { center = {}, boundary = {} }, pose_sensor = { center = {}, boundary = {} } }
    run:note("feedback pose_sensor: the loop is fed by the simulator's truth, late and noisy; no camera")
    for machine in run:each(p.machines, "machine") do
      rig.simulation:sample_machine(machine - 1)
      local found = { none = { center = {}, boundary = {} }, pose_sensor = { center = {}, boundary = {} } }
      for number in run:each(p.orientations, "orientation") do
        leave_alone(run, rig, p, machine, number, found)
      end
      for _, way in ipairs(ways) do
        for where, speeds in pairs(found[way]) do
          table.insert(worst[way][where], statistics.max(speeds))
        end
      end
    end
    report(run, rig:model().robot_name, worst)
  end,
}
