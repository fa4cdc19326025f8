-- Error that one observation of the robot on the known retina leaves: by calculation, with exact outlines, so that the error
-- of the optics' unknowns is separated from those of tracker, contour and pitch.
-- SPDX-License-Identifier: Apache-2.0
local retina = require "calibration.retina"
local statistics = require "analysis.statistics"
local units = require "units"
local mm = units.mm
local one_look = {}

-- The loop's own optics with another eye in it.
local function view_of(rig, eye)
  local model = rig:model()
  return eye:localizer { microscope = model.microscope, pixel = model.pixel, center = model.center_px }
end

-- Where it lies upright or flat, in the middle of the retina.
local function resting_place(model, axis)
  local upright = math.abs(axis.z) / axis:norm() > 0.7
  local thin = upright and model.robot.half_length or model.robot.radius
  return vector(0, 0, retina.resting_height(model.retina_radius, thin, 0))
end

--- Mean errors along x and z over `places` (world, m) of a loop that believes in the rig's eye, is calibrated by one look, and
--- sees exact outlines of its own spheroid, of known axis, through the eye `truth`. Nothing where too little of the way is seen.
function one_look.left(rig, truth, places, axis)
  local model, believed, true_view = rig:model(), view_of(rig, rig:eye()), view_of(rig, truth)
  local rest = resting_place(model, axis)
  local seen = true_view:ellipse { body = model.robot, position = rest, axis = axis }
  if not seen then return nil end
  local view = believed:calibrate({ body = model.robot, ellipse = seen, axis = axis, known_z = rest.z }).localizer
  local x, z = {}, {}
  for _, place in ipairs(places) do
    local at = place - model.eye_in_world
    local outline = true_view:ellipse { body = model.robot, position = at, axis = axis }
    local found = outline and view:locate { body = model.robot, ellipse = outline, position = at, axis = axis }
    if found and found.position then
      x[#x + 1], z[#z + 1] = math.abs(found.position.x - at.x), math.abs(found.position.z - at.z)
    end
  end
  if #z < 0.8 * #places then return nil end
  return { x = statistics.mean(x), z = statistics.mean(z) }
end

-- First order: 1 / magnification falls linearly with the height, to nothing where the chief rays meet. Returns that point's
-- height above the retina's vertex, and the magnification at `height`.
local function meeting_point(eye, height)
  local low, high = eye:axial_image(0), eye:axial_image(6 * mm)
  if not low or not high then return nil end
  local a, slope = 1 / low.magnification, (1 / high.magnification - 1 / low.magnification) / (6 * mm)
  return -a / slope, 1 / (a + slope * height)
end

--- The least that any estimator can leave of the depth, relative to the height above the place of the look, when all that it
--- knows is table 5.1 and that one look (the size, by first order): the look puts the magnification right there, and how it
--- changes with the height goes with where the chief rays meet, of which the magnification tells a little. Linear regression over
--- `count` eyes of table 5.1, others than those on the bench. Returns a function of an eye: what is left as it is calibrated, and
--- what the best estimator leaves.
function one_look.least(rig, axis, count)
  local eye, model = rig:eye(), rig:model()
  local height = resting_place(model, axis).z
  local meets, magnification = meeting_point(eye, height)
  local function both(other)
    local at, of = meeting_point(other, height)
    return (meets - height) / (at - height) - 1, of / magnification - 1
  end
  local slopes, scales = {}, {}
  for n = 1, count do
    slopes[n], scales[n] = both(eye:sample { number = 1000000 + n })
  end
  local line = statistics.line(scales, slopes)
  return function(other)
    local slope, scale = both(other)
    return math.abs(slope), math.abs(slope - line.intercept - line.slope * scale)
  end
end

return one_look
