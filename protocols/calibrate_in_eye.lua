-- Calibrates the viewing chain in the eye, without a side camera: the robot lands in several places of the retina, then flies
-- freely through the workspace while the field pitches it. Its size is measured before. The height above the retina that was
-- touched becomes known; the absolute depth only as well as the retina's own (docs/chain.md).
-- SPDX-License-Identifier: Apache-2.0
local bring = require "session.preparation"
local chain = require "calibration.chain"
local retina = require "calibration.retina"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, um, s, mT = units.mm, units.um, units.s, units.mT

local function open(rig, background, axis, p)
  return rig:servo { background = background, field = p.field, axis = axis, touch = true, lost_timeout = 10 * s }
end

-- Lets it sink below `above` and looks at it where it lies.
local function landing(rig, run, servo, above, p)
  local trim, from = bring.sink(run, servo, above)
  local look = chain.look(run, from)
  bring.lift(servo, trim, above)
  if not look then return nil end
  look.contact_sigma = p.roughness
  look.lying_height = retina.resting_height(rig:model().retina_radius, rig:model().robot.radius, 0)
  return look
end

-- The same place with the axis pitched by `pitch`, and a frame now and then on the way to it.
local function flights(run, servo, places, p)
  local looks, times = {}, {}
  for i, place in ipairs(places) do
    local pitch = p.pitch * math.sin(1.7 * i)
    local direction = vector(math.cos(pitch), 0, math.sin(pitch))
    local how = { within = 1 * mm, settle = 0.3 * s, speed = 2 * mm / s, timeout = 20 * s, direction = direction }
    local went, problem = pcall(function() servo:go_to(place, how) end)
    if not went then run:note("a place was not reached: " .. tostring(problem)) end
    if went then
      local from = run:now()
      run:wait(0.3 * s)
      local look = chain.look(run, from)
      if look then
        looks[#looks + 1], times[#times + 1] = look, from
      end
    end
  end
  return looks, times
end

-- Goes on flying with the calibrated chain, which the frames refine as they come (self-calibration while it works), until the
-- bench is no longer the calibrated one.
local function work_on(rig, run, servo, calibrated, p)
  local space, made = chain.workspace, nil
  local places = chain.places(rig, p.further, space.reach, space.low, space.high)
  for first = 1, #places, 10 do
    run:checkpoint "before ten further places"
    local ten = table.move(places, first, math.min(first + 9, #places), 1, {})
    local looks, times = flights(run, servo, ten, p)
    if #looks > 0 then made = chain.refine(run, made and made.chain or calibrated, looks, times) end
    if made and made.changed then
      run:note(("The bench has changed (%s): %d frames before it are kept. Calibrate anew."):format(made.changed, made.frames))
      break
    end
  end
  if not made then return end
  run:result("refined_by_frames", made.frames)
  run:result("refined_part_of_height", made.height, "m")
  run:result("bench_changed", made.changed and 1 or 0)
end

return {
  title = "Calibration of the viewing chain in the eye",
  needs = { "top_camera", "coils", "sample" },
  parameters = {
    landings = { default = 5, min = 1, max = 9, integer = true, help = "on the retina" },
    apart = { unit = "mm", default = 2 * mm, min = 0.5 * mm, max = 4 * mm, help = "of the outer ones from the middle" },
    frames = { default = 60, min = 5, max = 1000, integer = true, help = "of free flight, each at a place of its own" },
    further = {
      default = 0,
      min = 0,
      max = 1000,
      integer = true,
      help = "frames afterwards that refine the chain while it works",
    },
    pitch = { unit = "deg", default = 20 * units.deg, min = 0, max = 40 * units.deg, help = "of the robot in flight" },
    length = { unit = "mm", default = 2 * mm, min = 0.01 * mm, max = 20 * mm, help = "of the robot, measured" },
    width = { unit = "mm", default = 1 * mm, min = 0.01 * mm, max = 20 * mm, help = "of the robot, measured" },
    size_sigma = { default = 0.01, min = 1e-4, max = 0.1, help = "relative, of both" },
    roughness = { unit = "um", default = 30 * um, min = 1 * um, max = 500 * um, help = "of the retina where it lands" },
    field = { unit = "mT", default = 10 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
  },
  run = function(rig, p, run)
    local eye, looks = rig:model().eye_in_world, {}
    rig.sample:remove_robot()
    local background = rig:learn_background { frames = 10 }
    local servo <close> = open(rig, background, vector(1, 0, 0), p)
    bring.insert(rig, servo, vector(0, 0, 0))
    bring.trim(servo, vector(0, 0, 0), { rounds = 1, within = 1 * mm })
    for i in run:each(p.landings, "landing") do
      local angle = 2 * math.pi * (i - 2) / math.max(p.landings - 1, 1)
      local aside = i == 1 and vector(0, 0, 0) or p.apart * vector(math.cos(angle), math.sin(angle), 0)
      run:checkpoint("before a landing")
      looks[#looks + 1] = landing(rig, run, servo, eye + aside + vector(0, 0, 3 * mm), p)
    end
    if #looks == 0 then error("the robot was not seen on the retina", 0) end
    local space = chain.workspace
    run:checkpoint "before the flight"
    for _, look in ipairs(flights(run, servo, chain.places(rig, p.frames, space.reach, space.low, space.high), p)) do
      looks[#looks + 1] = look
    end
    local made = chain.calibrate(run, chain.believed(rig), {
      looks = looks,
      numbers = chain.size(rig, p.length, p.width, p.size_sigma),
    })
    chain.report(run, made)
    local heights = statistics.map(looks, function(look)
      local found = chain.locate(made.chain, look, made.outline)
      return found and found.height_sigma or 0 / 0
    end)
    run:result("height_sigma_median", statistics.median(heights), "m")
    run:headline(("Height above the retina to %s"):format(format_quantity(statistics.median(heights), "m")))
    chain.install(rig, run, made, true)
    if p.further > 0 then work_on(rig, run, servo, made.chain, p) end
  end,
}
