-- Mobility of robots in artificial vitreous (thesis 7.1, figure 7.1): eleven gels, from the porcine eye's to the human's; a
-- CoNi robot of 2 mm and an NdFeB cylinder of 1 mm; pulled straight with the coils' full force, and tumbled by a field that
-- turns while it is pulled. It has moved when it stays displaced after the force is gone.
-- SPDX-License-Identifier: Apache-2.0
local control = require "control"
local expect = require "analysis.expectations"
local published = require "analysis.published"
local units = require "units"
local mm, s, mT = units.mm, units.s, units.mT

local robots =
  { coni = { name = "coni_2mm", title = "CoNi, 2 mm" }, ndfeb = { name = "ndfeb_cylinder_1mm", title = "NdFeB, 1 mm" } }
local ways = { "pull", "tumble" }

local function last_seen(run, since)
  local span = { from = since, to = run:now() }
  local seen = run:samples("truth", { "x", "y", "z" }, span) or run:samples("side_camera", { "x", "z" }, span)
  local last = seen and #seen.time or 0
  return last > 0 and vector(seen.x[last], seen.y and seen.y[last] or 0, seen.z[last]) or nil
end

-- Where the robot is: of the simulator's truth where there is one, else as the side camera sees it. One that was seen since
-- `began` and is out of sight now has gone at least as far as it was seen.
local function place(run, began)
  run:wait(0.3 * s)
  local here = last_seen(run, run:now() - 1 * s)
  if here then return here end
  local edge = began and last_seen(run, began)
  if not edge then error("the robot is not seen", 0) end
  run:note("the robot has left the side camera's sight: it went at least as far as where it was seen last")
  return edge
end

-- Currents for a direction of the field and as much force along x, up to `force`, as the sum of all currents allows.
local function currents_for(model, robot, p, direction, force, each)
  while true do
    local found = model:allocate {
      position = { 0, 0, 0 },
      field = direction * p.field,
      force = { force, 0, 0 },
      robot = robot.name,
      limit = each,
    }
    local sum = 0
    for _, current in ipairs(found.currents) do
      sum = sum + math.abs(current)
    end
    if sum <= p.total or force == 0 then return found.currents end
    force = force > 1e-6 and 0.9 * force or 0
  end
end

-- Holds them for `time`, refreshed, or the coils' dead-man would end them.
local function push(rig, run, model, robot, p, time, direction_at, force)
  local began = run:now()
  while run:now() - began < time do
    rig.coils:set_currents(currents_for(model, robot, p, direction_at(run:now() - began), force, rig.coils:info().limit))
    run:wait(0.05 * s)
  end
end

local function along_x() return vector(1, 0, 0) end

local function attempt(rig, run, model, robot, p, gel, way)
  rig.sample:change_vial { robot = robot.name, gel = "gel_" .. gel }
  push(rig, run, model, robot, p, 1 * s, along_x, 0) -- lies along the field, held up
  local from, began = place(run), run:now()
  local function turning(time)
    local angle = 2 * math.pi * p.rate * time
    return vector(math.cos(angle), 0, math.sin(angle))
  end
  push(rig, run, model, robot, p, p.time, way == "tumble" and turning or along_x, p.force)
  push(rig, run, model, robot, p, 2 * s, along_x, 0)
  local went = (place(run, began) - from):norm()
  run:record(
    "motion",
    { gel = gel, hard = robot == robots.ndfeb and 1 or 0, tumbled = way == "tumble" and 1 or 0, distance = went },
    { distance = "m" },
    {
      gel = "number of the gel in the thesis' tables 7.1 and 7.2",
      hard = "1: the robot of hard magnet, 0: the soft one",
      tumbled = "1: turned about itself, 0: pulled along",
      distance = "how far it came",
    }
  )
  return went
end

return {
  title = "Motion in gels",
  needs = { "coils", "sample" },
  parameters = {
    gels = { default = 11, min = 1, max = 11, integer = true, help = "the first of tables 7.1 and 7.2" },
    robot = { choices = { "both", "coni", "ndfeb" }, default = "both", help = "which are tried" },
    time = { unit = "s", default = 4 * s, min = 0.5 * s, max = 60 * s, help = "of each attempt" },
    field = { unit = "mT", default = 20 * mT, min = 2 * mT, max = 40 * mT, help = "magnitude of the magnetic field" },
    force = {
      unit = "mN",
      default = 0.4 * units.mN,
      min = 0.001 * units.mN,
      max = 10 * units.mN,
      help = "asked for; the coils give what they can",
    },
    total = {
      unit = "A",
      default = 57 * units.A,
      min = 1 * units.A,
      max = 160 * units.A,
      help = "that all currents together may be",
    },
    rate = { unit = "Hz", default = 0.5, min = 0.05, max = 10, help = "of the field's turning when it tumbles" },
    moved = { unit = "mm", default = 0.3 * mm, min = 0.05 * mm, max = 5 * mm, help = "from how far on it has moved" },
  },
  run = function(rig, p, run)
    local model, tried = control.field_model { name = "octomag" }, p.robot == "both" and { "coni", "ndfeb" } or { p.robot }
    local went, rows = {}, {}
    -- Where there is no truth the side camera says where the robot is; it compares with the empty scene.
    if not rig.simulation and rig.top_camera and rig.side_camera then
      rig.sample:remove_robot()
      rig:learn_background { frames = 15 }
    end
    for gel in run:each(p.gels, "gel") do
      rows[gel] = { tostring(gel), ("%g"):format(published.gels.agar[gel]) }
      for _, key in ipairs(tried) do
        went[key] = went[key] or { pull = {}, tumble = {} }
        for _, way in ipairs(ways) do
          run:checkpoint(("before gel %d, %s, %s"):format(gel, key, way))
          local distance = attempt(rig, run, model, robots[key], p, gel, way)
          went[key][way][gel] = distance
          rows[gel][#rows[gel] + 1] = ("%s (%.2f mm)"):format(distance >= p.moved and "moved" or "held", distance / mm)
        end
      end
    end
    local header = { "gel", "agar, mg/mL" }
    for _, key in ipairs(tried) do
      for _, way in ipairs(ways) do
        header[#header + 1] = ("%s, %s"):format(robots[key].title, way)
      end
    end
    run:table { title = "Figure 7.1: which moved in which", header = header, rows = rows }
    local series = {}
    for _, key in ipairs(tried) do
      for _, way in ipairs(ways) do
        local x, y = {}, {}
        for gel = 1, p.gels do
          x[gel], y[gel] = published.gels.agar[gel], went[key][way][gel]
        end
        series[#series + 1] = { label = robots[key].title .. ", " .. way, x = x, y = y, mark = "points" }
      end
    end
    run:plot { title = "How far they went", x = { "agar, mg/mL", "" }, y = { "distance", "mm" }, series = series }
    local book = expect.book(run, "figure 7.1")
    local function row(id, what, key, way, gel, expected, why)
      if not (went[key] and went[key][way][gel]) then return end
      book:number {
        id = id,
        what = what,
        thesis = expected,
        ours = went[key][way][gel] >= p.moved and 1 or 0,
        within = 0,
        reason = "1: moves, 0: does not",
        why = why,
      }
    end
    local fitted = "the gels' stiffness and yield strain are assumed, fitted to this sentence (docs/simulated_laboratory.md)"
    row("7.1.coni_pull_pig", "CoNi is pulled through the thinnest gel", "coni", "pull", 1, 0, fitted)
    row(
      "7.1.coni_tumble_pig",
      "CoNi tumbles through the thinnest gel",
      "coni",
      "tumble",
      1,
      1,
      "one yield surface for force and torque: assumed"
    )
    row("7.1.ndfeb_pull_pig", "NdFeB is pulled through the thinnest gel", "ndfeb", "pull", 1, 1, fitted)
    row("7.1.ndfeb_pull_human", "NdFeB is pulled through the first human gel", "ndfeb", "pull", 6, 1, fitted)
    local most = 0
    for _, key in ipairs(tried) do
      for gel = 1, p.gels do
        if key == "ndfeb" and went[key].pull[gel] >= p.moved then most = gel end
      end
    end
    if went.ndfeb then
      book:number {
        id = "7.1.ndfeb_pull_last",
        what = "last gel that NdFeB is pulled through",
        ours = most,
        why = 'the text has no more than "from the simulated porcine vitreous to reported human-eye values"',
      }
    end
    book:close()
  end,
}
