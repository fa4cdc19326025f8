-- Mobility of robots in artificial vitreous (thesis 7.1, figure 7.1): eleven gels, from the porcine eye's to the human's, or
-- those of a rheometer's table; a CoNi robot of 2 mm and an NdFeB cylinder of 1 mm; pulled straight with the coils' full force,
-- and tumbled by a field that turns while it is pulled, which is also turned ever faster until the robot steps out. It has moved
-- when it stays displaced after the force is gone.
-- SPDX-License-Identifier: Apache-2.0
local control = require "control"
local expect = require "analysis.expectations"
local gels = require "session.gels"
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

-- Holds them for `time`, refreshed (every 50 ms or `every`), or the coils' dead-man would end them.
local function push(rig, run, model, robot, p, time, direction_at, force, every)
  local began = run:now()
  while run:now() - began < time do
    rig.coils:set_currents(currents_for(model, robot, p, direction_at(run:now() - began), force, rig.coils:info().limit))
    run:wait(every or 0.05 * s)
  end
end

local function along_x() return vector(1, 0, 0) end

local function change_vial(rig, robot, gel)
  local vial = { robot = robot.name }
  for key, value in pairs(gel.vial) do
    vial[key] = value
  end
  rig.sample:change_vial(vial)
end

-- In the plane of x and z.
local function turning_at(rate)
  return function(time)
    local angle = 2 * math.pi * rate * time
    return vector(math.cos(angle), 0, math.sin(angle))
  end
end

-- How far the robot's axis turned since `began`, rad; nil where there is no truth to say it.
local function turned(run, began)
  local seen = run:samples("truth", { "axis_x", "axis_z" }, { from = began, to = run:now() })
  if not seen then return nil end
  local sum, last = 0, nil
  for i = 1, #seen.time do
    local angle = math.atan(seen.axis_z[i], seen.axis_x[i])
    if last then sum = sum + (angle - last + math.pi) % (2 * math.pi) - math.pi end
    last = angle
  end
  return math.abs(sum)
end

-- The fastest of the rates, doubled from 0.5 Hz, at which the robot turns with the field for two turns and more than nine tenths
-- of them; 0 where it does not turn at all, nil where nothing says it.
local function fastest(rig, run, model, robot, p, gel)
  change_vial(rig, robot, gel)
  push(rig, run, model, robot, p, 1 * s, along_x, 0)
  local best = 0
  for _, rate in ipairs { 0.5, 1, 2, 4, 8 } do
    local began, time = run:now(), math.max(1, 2 / rate)
    push(rig, run, model, robot, p, time, turning_at(rate), 0, 0.012 * s)
    local angle = turned(run, began)
    if not angle then return nil end
    if angle < 0.9 * 2 * math.pi * rate * time then break end
    best = rate
  end
  push(rig, run, model, robot, p, 0.5 * s, along_x, 0)
  return best
end

local function attempt(rig, run, model, robot, p, number, gel, way)
  change_vial(rig, robot, gel)
  push(rig, run, model, robot, p, 1 * s, along_x, 0) -- lies along the field, held up
  local from, began = place(run), run:now()
  push(rig, run, model, robot, p, p.time, way == "tumble" and turning_at(p.rate) or along_x, p.force)
  push(rig, run, model, robot, p, 2 * s, along_x, 0)
  local went = (place(run, began) - from):norm()
  run:record(
    "motion",
    { gel = number, hard = robot == robots.ndfeb and 1 or 0, tumbled = way == "tumble" and 1 or 0, distance = went },
    { distance = "m" },
    {
      gel = "number of the gel in the thesis' tables 7.1 and 7.2, or of the rheometer's row",
      hard = "1: the robot of hard magnet, 0: the soft one",
      tumbled = "1: turned about itself, 0: pulled along",
      distance = "how far it came",
    }
  )
  return went
end

-- The axes of figure 7.1, with what became of the robot: pulled through, tumbled through, or held.
local function figure_7_1(run, p, robot, list, went)
  local marks = { { "pulled through" }, { "only tumbled through" }, { "held" } }
  for _, mark in ipairs(marks) do
    mark.x, mark.y = {}, {}
  end
  for number, gel in ipairs(list) do
    local mark = marks[went.pull[number] >= p.moved and 1 or went.tumble[number] >= p.moved and 2 or 3]
    mark.x[#mark.x + 1], mark.y[#mark.y + 1] = gel.storage, gel.loss
  end
  local series = {}
  for _, mark in ipairs(marks) do
    if #mark.x > 0 then series[#series + 1] = { label = mark[1], x = mark.x, y = mark.y, mark = "points" } end
  end
  run:plot {
    title = "Figure 7.1: " .. robot.title,
    x = { "storage modulus G'", "Pa" },
    y = { "loss modulus G''", "Pa" },
    series = series,
    note = p.rheometer == "" and "moduli assumed: the thesis has them in the figure only" or "moduli by the rheometer's table",
  }
end

return {
  title = "Motion in gels",
  needs = { "coils", "sample" },
  parameters = {
    gels = { default = 11, min = 1, max = 11, integer = true, help = "the first of tables 7.1 and 7.2, or of the rheometer's" },
    rheometer = {
      default = "",
      help = "CSV of measured gels: name, agar_mg_per_mL, frequency_Hz, storage_Pa, loss_Pa; empty: those of the tables, assumed",
    },
    step_out = { default = true, help = "turn the field ever faster, too, until the tumbling robot steps out" },
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
    local list = p.rheometer == "" and gels.assumed(p.gels) or gels.measured(p.rheometer, p.gels)
    local went, rows, turns = {}, {}, {}
    -- Where there is no truth the side camera says where the robot is; it compares with the empty scene.
    if not rig.simulation and rig.top_camera and rig.side_camera then
      rig.sample:remove_robot()
      rig:learn_background { frames = 15 }
    end
    for number in run:each(#list, "gel") do
      local gel = list[number]
      rows[number] = {
        gel.name,
        gel.agar and ("%g"):format(gel.agar) or "–",
        ("%.3g"):format(gel.storage),
        ("%.3g at %g Hz"):format(gel.loss, gel.frequency),
      }
      for _, key in ipairs(tried) do
        went[key] = went[key] or { pull = {}, tumble = {} }
        turns[key] = turns[key] or {}
        for _, way in ipairs(ways) do
          run:checkpoint(("before gel %s, %s, %s"):format(gel.name, key, way))
          local distance = attempt(rig, run, model, robots[key], p, number, gel, way)
          went[key][way][number] = distance
          rows[number][#rows[number] + 1] = ("%s (%.2f mm)"):format(distance >= p.moved and "moved" or "held", distance / mm)
        end
        local best = p.step_out and fastest(rig, run, model, robots[key], p, gel) or nil
        turns[key][number] = best
        rows[number][#rows[number] + 1] = best and (best > 0 and ("%g Hz"):format(best) or "not at 0.5 Hz") or "–"
      end
    end
    local header = { "gel", "agar, mg/mL", "G', Pa", "G'', Pa" }
    for _, key in ipairs(tried) do
      for _, way in ipairs(ways) do
        header[#header + 1] = ("%s, %s"):format(robots[key].title, way)
      end
      header[#header + 1] = robots[key].title .. ", turns with the field up to"
    end
    run:table { title = "Figure 7.1: which moved in which", header = header, rows = rows }
    for _, key in ipairs(tried) do
      figure_7_1(run, p, robots[key], list, went[key])
    end
    if p.rheometer ~= "" then return run:note("the gels are the rheometer's: nothing of the thesis is compared") end
    local book = expect.book(run, "figure 7.1")
    local function row(id, what, key, way, gel, expected, why, by_fit)
      if not (went[key] and went[key][way][gel]) then return end
      book:number {
        id = id,
        what = what,
        thesis = expected,
        ours = went[key][way][gel] >= p.moved and 1 or 0,
        within = not by_fit and 0 or nil,
        reason = "1: moves, 0: does not",
        why = why,
      }
    end
    local fitted = "the gels' stiffness and yield strain are assumed, fitted to this sentence (docs/simulated_laboratory.md)"
    row("7.1.coni_pull_pig", "CoNi is pulled through the thinnest gel", "coni", "pull", 1, 0, fitted, true)
    row(
      "7.1.coni_tumble_pig",
      "CoNi tumbles through the thinnest gel",
      "coni",
      "tumble",
      1,
      1,
      "one yield surface for force and torque: assumed"
    )
    row("7.1.ndfeb_pull_pig", "NdFeB is pulled through the thinnest gel", "ndfeb", "pull", 1, 1, fitted, true)
    row("7.1.ndfeb_pull_human", "NdFeB is pulled through the first human gel", "ndfeb", "pull", 6, 1, fitted, true)
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
    for _, key in ipairs(tried) do
      if turns[key][1] then
        book:number {
          id = "7.1.step_out." .. key,
          what = robots[key].title .. ": turns with the field in the thinnest gel up to, per s",
          ours = turns[key][1],
          why = "of 0.5, 1, 2, 4, 8; the thesis names no rate",
        }
      end
    end
    book:close()
  end,
}
