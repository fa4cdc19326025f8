-- Error that one observation of the robot on the known retina leaves: by calculation, with exact outlines, so that the error
-- of the optics' unknowns is separated from those of tracker, contour and pitch.
-- SPDX-License-Identifier: Apache-2.0
local chains = require "calibration.chain"
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

-- px: the least that a tracker's ellipse is known to, and a look of two seconds.
local frame_sigma, look_sigma = 0.02, 0.05

-- One sigma of what the simulated bench is off by beside the eye's numbers (docs/simulated_laboratory.md).
local bench = { pixel = 0.005, robot_size = 0.01, microscope_tilt = 3.5e-3 }
local eye_place = 50 * units.um

-- Mean of |x + y|, x fixed and y normal of this sigma: the folded normal distribution.
local function folded(x, sigma)
  if sigma <= 0 then return math.abs(x) end
  local r, sum = math.abs(x) / sigma, 0
  for i = -40, 40 do -- trapezoids: exact to 1e-9 for a smooth integrand that ends
    local n = i / 8
    sum = sum + math.abs(r + n) * math.exp(-n * n / 2) / 8
  end
  return sigma * sum / math.sqrt(2 * math.pi)
end

--- Bound of the information: the mean error along z over `places` (world, m) that half of all eyes are below, of the best
--- estimator that knows table 5.1 and how well the simulated bench is known (pixel 0.5 %, robot 1 %, tilt 3.5 mrad, eye's place
--- 50 µm), one look at the robot on the retina, whose height is known to 10 µm, and in each frame an ellipse to 0.02 px, of a
--- robot whose axis is known to `axis_sigma` (rad) beforehand. By the inverse of the information of prior, look and frame
--- (docs/chain.md). What eye and bench do is common to all places, the noise is new at each. Returns it, and of it the eye's
--- and bench's and the frame's part alone, m.
function one_look.information(rig, places, axis, axis_sigma)
  local model, uncertain = rig:model(), {}
  for _, name in ipairs {
    "axial_length",
    "lens_axial",
    "lens_aside",
    "lens_tilt",
    "eye_rotation",
    "inner_lens_tilt",
    "inner_lens_aside",
    "pupil_power",
    "object_plane",
    "center",
    "dilation_px",
    "dilation_slope",
    "axis_turn",
    "retina_depth",
    "retina_tilt",
    "retina_curvature",
    "retina_astigmatism",
  } do
    uncertain[name] = 0
  end
  for name, sigma in pairs(bench) do
    uncertain[name] = sigma
  end
  local before = chains.believed(rig, uncertain)
  local rest = resting_place(model, axis)
  local look = before:ellipse { position = rest, axis = axis }
  look.axis, look.axis_sigma, look.sigma = axis, axis_sigma, look_sigma
  look.contact_sigma, look.lying_height = 10 * units.um, rest.z
  local after = before:calibrate({ looks = { look }, starts = 1 }).chain
  local median_of_normal, all, eye, frame = 0.6745, {}, {}, {}
  for _, place in ipairs(places) do
    local seen = after:ellipse { position = place - model.eye_in_world, axis = axis }
    if seen then
      seen.sigma = frame_sigma
      local found = after:locate { ellipse = seen, axis = axis, axis_sigma = axis_sigma }
      if found then
        local of_frame = found.noise.z
        local of_eye = median_of_normal * math.sqrt(found.sigma.z ^ 2 - of_frame ^ 2 + eye_place ^ 2)
        all[#all + 1] = folded(of_eye, of_frame)
        eye[#eye + 1], frame[#frame + 1] = of_eye, folded(0, of_frame)
      end
    end
  end
  return statistics.mean(all), statistics.mean(eye), statistics.mean(frame)
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
