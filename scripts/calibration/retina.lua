-- Calibration of the loop's view on the known retina (thesis 6.2: "we can calibrate the algorithm by estimating the
-- microrobot's position when it lies on the known retinal depth"): one observation of the robot at rest corrects the image's
-- scale, or says which eye of table 5.1 is the most probable one.
-- SPDX-License-Identifier: Apache-2.0
local bring = require "session.preparation"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, um, s = units.mm, units.um, units.s
local retina = {}

--- Height over the retina's vertex of a body's middle that lies on a sphere, its thin side down, `aside` from the axis.
function retina.resting_height(radius, half_thickness, aside)
  local reach = radius - half_thickness
  if aside >= reach then error("retina.resting_height: no body rests so far aside", 2) end
  return radius - math.sqrt(reach ^ 2 - aside ^ 2)
end

-- The tracker's mean ellipse since `from`; nothing when it was not seen.
local function ellipse_since(run, from)
  local seen = {}
  local channels = { u = "u_px", v = "v_px", semi_major = "semi_major_px", semi_minor = "semi_minor_px", angle = "angle" }
  local servo = run:samples("servo", nil, { from = from, to = run:now() })
  for name, channel in pairs(channels) do
    local good = {}
    for _, value in ipairs(servo[channel]) do
      if value == value then good[#good + 1] = value end
    end
    if #good == 0 then return nil end
    seen[name] = name == "angle" and statistics.median(good) or statistics.mean(good)
  end
  return seen
end

-- What the tracker saw, with the length that goes with its width for a robot that lies straight at `place`: what a loop that
-- takes the depth from the width alone believes.
local function by_width(view, robot, seen, place, axis)
  local straight = view:ellipse { body = robot, position = place, axis = axis }
  if not straight then error("the robot on the retina is outside of the view", 0) end
  local same = {}
  for name, value in pairs(seen) do
    same[name] = value
  end
  same.semi_major = seen.semi_minor * straight.semi_major / straight.semi_minor
  return same
end

-- px: of a mean of two seconds of frames, and of how far the outline of plates is from the ellipsoid's.
local look_sigma, contour_sigma = 0.05, 0.1

-- What only the correction "eye" asks for. A robot that stands or lies askew is longer or shorter, which its prior allows for.
-- What rig file and bench leave open of pixel and robot takes its part of what the look shows.
local function of_eye(options, known)
  if options.correction ~= "eye" then return {} end
  return {
    axis_sigma = options.axis_sigma or 4 * units.deg,
    contour_sigma = contour_sigma,
    sigma = look_sigma,
    pixel_sigma = known.pixel,
    size_sigma = known.size,
  }
end

--- Lays the robot on the retina under `above` and returns what view:calibrate says: `localizer` is the view for rig:servo.
--- `depth_error`: by how much the retina's depth is known wrongly, m (0). `by_width`: for a loop that estimates how the robot
--- lies (axis_uncertainty of rig:servo) and so takes the depth from its width alone. `correction`: what is put right, as
--- view:calibrate has it; of an eye `axis_sigma` says how well the axis is known (4 degrees). The robot is left where it lies,
--- and `trim` is to be taken back.
function retina.calibrate(rig, run, servo, options)
  local model = rig:model()
  local above = options.above or model.eye_in_world + vector(0, 0, 3.2 * mm) -- clear of the margin, upright in an unknown eye too
  local trim, from = bring.sink(run, servo, above)
  local seen = ellipse_since(run, from)
  if not seen then error("the robot was not seen on the retina: nothing to calibrate with", 0) end
  local view = rig:view()
  local axis = vector(options.axis or { 1, 0, 0 })
  local lies = { robot = model.robot, axis = axis }
  -- Where it lies aside of the axis, by first order: the height hardly depends on it, and the view of now may not know it at all.
  local magnification = math.abs(rig:eye():axial_image(0).magnification)
  local meters = model.pixel / magnification
  local x, y = (seen.u - model.center_px[1]) * meters, -(seen.v - model.center_px[2]) * meters
  local aside = math.sqrt(x ^ 2 + y ^ 2)
  local upright = math.abs(axis.z) / axis:norm() > 0.7
  local thin = upright and model.robot.half_length or model.robot.radius
  lies.height = retina.resting_height(model.retina_radius, thin, math.min(aside, 0.5 * model.retina_radius))
    + (options.depth_error or 0)
  local wanted = of_eye(options, model.uncertainty)
  seen.sigma = wanted.sigma
  if options.by_width and options.correction ~= "eye" then
    seen = by_width(view, model.robot, seen, vector(x, y, lies.height), axis)
  end
  local told = view:calibrate {
    body = model.robot,
    ellipse = seen,
    axis = axis,
    known_z = lies.height,
    correction = options.correction,
    axis_sigma = wanted.axis_sigma,
    contour_sigma = wanted.contour_sigma,
    pixel_sigma = wanted.pixel_sigma,
    size_sigma = wanted.size_sigma,
  }
  run:note(
    ("calibrated on the retina: %s, residual %.3f µm"):format(
      options.correction == "eye" and "the most probable eye of table 5.1"
        or ("image scale %.4f, offset %s"):format(told.image_scale, format_quantity(vector(told.offset):norm(), "m")),
      told.residual / um
    )
  )
  told.trim = trim
  return told
end

--- A protocol's parameter `calibrate`: whether the robot is looked at on the retina before it works. `when`: of "auto".
function retina.parameter(when)
  return {
    choices = { "auto", "yes", "no" },
    default = "auto",
    help = "on the retina, before, as in thesis 6.2; auto: " .. when .. " the bench was set up by hand",
  }
end

--- Whether the top camera looks through an eye whose bench counts as set up by hand.
function retina.by_hand(rig)
  local model = rig:model()
  return rig.top_camera ~= nil and not model.plain_view and model.uncertainty.bench.places == "by_hand"
end

--- Whether the loop locates by a chain that calibrate_bench or calibrate_in_eye have installed.
function retina.measured(rig) return rig:model().uncertainty.bench.places == "measured" end

--- By how much a square's center is higher there: a look in the middle of the retina tells nothing of where the picture stands
--- aside, 0.8 mm of such a bench, which at the corners is 0.3 mm of distance to the retina, one sigma (docs/safety.md). A chain
--- that was measured by a side camera leaves the retina where it may be, to 0.3 mm; one with landings in it does not.
function retina.room(rig)
  local open = retina.measured(rig) and rig:model().uncertainty.bench.retina_depth > 0.1 * mm
  return vector(0, 0, (retina.by_hand(rig) or open) and 0.5 * mm or 0)
end

--- Whether to look, by that parameter; says why in the record where the bench is why. Where the retina of a bench that was set up
--- by hand stands is known to 0.3 mm, and what the robot's size in the image says of its height to as much again: near it a loop
--- has to have seen the robot lying on it (docs/safety.md). `otherwise`: another reason to look.
function retina.wanted(rig, run, choice, otherwise)
  if choice ~= "auto" or otherwise then return choice ~= "no" end
  if not retina.by_hand(rig) then return false end
  run:note "the bench counts as set up by hand: the robot is looked at on the retina first (calibrate=no: it is not)"
  return true
end

--- A view for rig:servo, calibrated in a loop of its own (field, axis as rig:servo takes them; by_width as retina.calibrate
--- does), with a picture called `snapshot` if it is given. The robot is taken out again.
function retina.view(rig, run, background, options)
  local servo <close> = rig:servo {
    background = background,
    field = options.field,
    axis = options.axis,
    lost_timeout = 5 * s,
  }
  bring.insert(rig, servo, vector(0, 0, 0))
  bring.trim(servo, vector(0, 0, 0), { rounds = 1, within = 1 * mm })
  local told = retina.calibrate(rig, run, servo, { axis = options.axis, by_width = options.by_width })
  if options.snapshot then servo:snapshot(options.snapshot) end
  rig.sample:remove_robot()
  return told.localizer
end

return retina
