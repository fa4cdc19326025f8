-- Calibrates the viewing chain ex vivo, by both cameras: the robot goes to places throughout the workspace, and the side
-- camera says where it is. Its size is measured before, under a microscope. Eye, condensing lens, eye rotation, microscope,
-- scale and center are estimated together (docs/chain.md); further places judge the result and its uncertainty.
-- SPDX-License-Identifier: Apache-2.0
local bring = require "session.preparation"
local chain = require "calibration.chain"
local judge = require "analysis.path_accuracy"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, um, s, mT = units.mm, units.um, units.s, units.mT

-- Goes to a place and looks while it is held; nothing where one of the cameras did not see it.
local function look_at(rig, run, servo, place, p)
  local how = { within = 0.8 * mm, settle = 0.5 * s, speed = 2 * mm / s, timeout = 20 * s }
  local went, problem = pcall(function() servo:go_to(place, how) end)
  if not went then
    run:note("a place was not reached: " .. tostring(problem))
    return nil
  end
  local from = run:now()
  run:wait(p.listen)
  local look = chain.look(run, from)
  if not look then return nil end
  if not chain.add_side(rig, run, look, from, p.side_sigma) then return nil end
  look.from, look.to = from, run:now()
  return look
end

-- Where it really was, in the eye's frame: by truth in a simulated laboratory, else as the side camera had it.
local function real_place(rig, run, look)
  local stream = judge.reference(run)
  local channels = stream == "truth" and { "x", "y", "z" } or { "x", "z" }
  local seen = run:samples(stream, channels, { from = look.from, to = look.to })
  local eye = rig:model().eye_in_world
  local y = seen.y and statistics.mean(seen.y) or eye.y
  return vector(statistics.mean(seen.x), y, statistics.mean(seen.z)) - eye
end

local function entry(look)
  local one = {}
  for name, value in pairs(look) do
    if name ~= "from" and name ~= "to" then one[name] = value end
  end
  return one
end

local function judged(rig, run, looks, calibrated, name, outline)
  local all = {}
  for i, look in ipairs(looks) do
    all[i] = { look = look, place = real_place(rig, run, look) }
  end
  local found = chain.judge(calibrated, all, outline)
  if #found.depth == 0 then error(name .. ": no place could be located", 0) end
  run:result(name .. "_depth_median", statistics.median(found.depth), "m")
  run:result(name .. "_depth_90", statistics.percentile(found.depth, 0.9), "m")
  run:result(name .. "_aside_median", statistics.median(found.aside), "m")
  run:result(name .. "_within_95", found.covered)
  run:headline(("Depth of further places to %s, median"):format(format_quantity(statistics.median(found.depth), "m")))
end

return {
  title = "Calibration of the viewing chain by both cameras",
  needs = { "top_camera", "side_camera", "coils", "sample" },
  parameters = {
    places = { default = 30, min = 5, max = 200, integer = true, help = "that calibrate" },
    judged = { default = 10, min = 2, max = 100, integer = true, help = "further ones, that judge" },
    length = { unit = "mm", default = 2 * mm, min = 0.01 * mm, max = 20 * mm, help = "of the robot, measured" },
    width = { unit = "mm", default = 1 * mm, min = 0.01 * mm, max = 20 * mm, help = "of the robot, measured" },
    size_sigma = { default = 0.01, min = 1e-4, max = 0.1, help = "relative, of both" },
    side_sigma = { unit = "um", default = 15 * um, min = 1 * um, max = 500 * um, help = "of the side camera's places" },
    listen = { unit = "s", default = 1 * s, min = 0.2 * s, max = 30 * s, help = "how long each place is looked at" },
    field = { unit = "mT", default = 10 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
  },
  run = function(rig, p, run)
    rig.sample:remove_robot()
    local background = rig:learn_background { frames = 10 }
    local servo <close> = rig:servo { background = background, feedback = "two_cameras", field = p.field, axis = vector(1, 0, 0) }
    bring.insert(rig, servo, vector(0, 0, 0))
    bring.trim(servo, vector(0, 0, 0), { rounds = 1, within = 1 * mm })
    local space, looks, further = chain.workspace, {}, {}
    local every, i = math.max(2, math.floor((p.places + p.judged) / p.judged)), 0
    for place in run:each(chain.places(rig, p.places + p.judged, space.reach, space.low, space.high), "place") do
      run:checkpoint("before a place")
      i = i + 1
      local look = look_at(rig, run, servo, place, p)
      if not look then
        run:note "a place was not seen by both cameras"
      elseif i % every == 0 and #further < p.judged then
        further[#further + 1] = look
      else
        looks[#looks + 1] = look
      end
    end
    if #looks < 5 then error("fewer than five places were seen by both cameras", 0) end
    local believed = chain.believed(rig)
    local made = chain.calibrate(run, believed, {
      looks = statistics.map(looks, entry),
      numbers = chain.size(rig, p.length, p.width, p.size_sigma),
    })
    chain.report(run, made)
    judged(rig, run, further, believed, "before")
    judged(rig, run, further, made.chain, "after", made.outline)
    chain.install(rig, run, made, false)
  end,
}
