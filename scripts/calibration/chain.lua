-- Calibration of the whole viewing chain by pictures of the robot: what a session records of it, and what its calibration
-- says (docs/chain.md). A chain is a viewing_chain of the module optics.
-- SPDX-License-Identifier: Apache-2.0
local statistics = require "analysis.statistics"
local units = require "units"
local files = require "files"
local json = require "json"
local um, mm = units.um, units.mm
local chain = {}

--- px, of each semi-axis: how far the outline of crossed plates is from an ellipsoid's, beside what is common to all. A session
--- finds its own, not below a third of this: what a tracker's rim is known to on pictures (docs/vision.md).
chain.contour_sigma = 0.15
local least_factor = 1 / 3

--- rad, about each axis: by how much coils that are not measured turn the field, alike wherever the robot is: 2.1 degrees in the
--- mean of a session, and 1.1 about that (docs/chain.md). What is left is a look's own, axis_sigma.
chain.axis_turn = 2.5 * units.deg

--- m, of the plane in focus of a microscope that was focused by eye.
chain.focus_sigma = 0.5 * mm

--- The rig's chain as it is believed. Its robot is a spheroid, or plates that fill one: of a cylinder the looks' ellipses would
--- have to be converted first, as view:calibrate does. `sigmas`: what is uncertain of it otherwise than `uncertainty` of
--- viewing_chain has it.
function chain.believed(rig, sigmas)
  local model, uncertainty = rig:model(), { axis_turn = chain.axis_turn }
  for name, sigma in pairs(sigmas or {}) do
    uncertainty[name] = sigma
  end
  return rig:eye():viewing_chain {
    microscope = model.microscope,
    body = { shape = "spheroid", half_length = model.robot.half_length, radius = model.robot.radius },
    pixel = model.pixel,
    center = model.center_px,
    plate_ratio = model.robot_plate_ratio,
    uncertainty = uncertainty,
  }
end

local function finite(values)
  local good = {}
  for _, value in ipairs(values) do
    if value == value then good[#good + 1] = value end
  end
  return good
end

-- Means of some channels of a stream since `from`; nothing when one of them has no value.
local function means(run, stream, channels, from)
  local seen, found = run:samples(stream, channels, { from = from, to = run:now() }), {}
  if not seen then return nil end
  for _, name in ipairs(channels) do
    local good = finite(seen[name])
    if #good == 0 then return nil end
    found[name] = name == "angle" and statistics.median(good) or statistics.mean(good)
    found.count = #good
  end
  return found
end

--- What the loop's top camera saw of the robot since `from`, as viewing_chain:calibrate takes a look; nothing where it was not
--- seen. The noise of a frame averages down to a twentieth of a pixel: what is left is no noise.
function chain.look(run, from, frame_sigma)
  local seen = means(run, "servo", { "u_px", "v_px", "semi_major_px", "semi_minor_px", "angle" }, from)
  local axis = means(run, "command", { "axis_x", "axis_y", "axis_z" }, from)
  if not seen or not axis then return nil end
  return {
    u = seen.u_px,
    v = seen.v_px,
    semi_major = seen.semi_major_px,
    semi_minor = seen.semi_minor_px,
    angle = seen.angle,
    sigma = math.max(0.05, (frame_sigma or 0.2) / math.sqrt(seen.count)),
    contour_sigma = chain.contour_sigma,
    axis = vector(axis.axis_x, axis.axis_y, axis.axis_z),
  }
end

--- Where the side camera had it meanwhile, into the look: x and z in the eye's frame, to `sigma`; y was not measured. False
--- where it had none.
function chain.add_side(rig, run, look, from, sigma)
  local seen = means(run, "side_camera", { "x", "z" }, from)
  if not seen then return false end
  local eye = rig:model().eye_in_world
  look.position = vector(seen.x - eye.x, 0, seen.z - eye.z)
  look.position_sigma = vector(sigma, 0, sigma)
  return true
end

--- The robot's size measured under a microscope, relative to what the rig believes, as numbers of a session.
function chain.size(rig, length, width, sigma)
  local robot = rig:model().robot
  return {
    { parameter = "robot_length", off = length / (2 * robot.half_length) - 1, sigma = sigma },
    { parameter = "robot_width", off = width / (2 * robot.radius) - 1, sigma = sigma },
  }
end

--- What a target without an eye said of the microscope (calibrations.microscope), as numbers of a session. The plane in focus
--- lies where the focus stage has it, to `chain.focus_sigma`: of it the pixel is uncertain, as the image grows with height.
function chain.microscope_numbers(rig, fit)
  local model = rig:model()
  local distance, tilt = model.microscope.pupil_distance, model.microscope.tilt
  local of_plane = math.abs(fit.pupil_power) * chain.focus_sigma
  local aside_sigma = math.max(fit.center_sigma_px[1], fit.center_sigma_px[2]) * fit.pixel
  return {
    { parameter = "pupil_power", off = fit.pupil_power - (distance and 1 / distance or 0), sigma = fit.pupil_power_sigma },
    { parameter = "pixel", off = fit.pixel / model.pixel - 1, sigma = vector(fit.pixel_sigma / fit.pixel, of_plane, 0):norm() },
    { parameter = "microscope_tilt_x", off = fit.tilt[1] - tilt[1], sigma = fit.tilt_sigma[1] },
    { parameter = "microscope_tilt_y", off = fit.tilt[2] - tilt[2], sigma = fit.tilt_sigma[2] },
    { parameter = "center_x", off = (fit.center[1] - model.center_px[1]) * fit.pixel, sigma = aside_sigma },
    { parameter = "center_y", off = (model.center_px[2] - fit.center[2]) * fit.pixel, sigma = aside_sigma },
  }
end

--- Cells of a table of such numbers.
function chain.rows(numbers)
  local rows = {}
  for i, one in ipairs(numbers) do
    rows[i] = { one.parameter, ("%.4g"):format(one.off), ("%.2g"):format(one.sigma) }
  end
  return rows
end

-- The session without the looks of these numbers.
local function without(session, outliers)
  local left, rest = {}, {}
  for _, one in ipairs(outliers) do
    left[one.look] = true
  end
  for name, value in pairs(session) do
    rest[name] = value
  end
  rest.looks = {}
  for i, look in ipairs(session.looks) do
    if not left[i] then rest.looks[#rest.looks + 1] = look end
  end
  return rest
end

-- The session with outlines that are `factor` times as far from the model's.
local function with_outlines(session, factor)
  local other, looks = {}, {}
  for i, look in ipairs(session.looks) do
    looks[i] = {}
    for name, value in pairs(look) do
      looks[i][name] = value
    end
    looks[i].contour_sigma = factor * (look.contour_sigma or chain.contour_sigma)
  end
  for name, value in pairs(session) do
    other[name] = value
  end
  other.looks = looks
  return other
end

local function explained(made) return made.status == "found" or made.status == "ambiguous" end

-- By what factor outlines are nearer to the model's than believed: the smallest by which chi square is at most its degrees of
-- freedom. What is claimed of outlines is part of every position's uncertainty, and weighs the looks against what else is known.
local function nearer(believed, session, made)
  local factor = least_factor
  while factor < 0.9 do
    local other = believed:calibrate(with_outlines(session, factor))
    if explained(other) and other.chi2 <= other.degrees_of_freedom then return other, factor end
    factor = 1.5 * factor
  end
  return made, 1
end

--- Calibrates a chain by a session, as viewing_chain:calibrate takes it. A session that no chain explains is refused with its
--- cause. Where it is a few looks (a place that the other camera had wrong, another thing for the robot), they are named and
--- left out, a tenth of them at most. Outlines are taken for as far from the model's as the session says, from a third of
--- `chain.contour_sigma` to three times as much, which every uncertainty follows; what does not fit then is wrong by more than an
--- outline. Returns what viewing_chain:calibrate says, with `outline`, in px, beside it.
function chain.calibrate(run, believed, session)
  local made, factor = believed:calibrate(session), 1
  local bad = made.outliers
  for _, one in ipairs(bad) do
    run:note(("look %d does not fit the others: chi square %.0f"):format(one.look, one.chi2))
  end
  if not explained(made) and #bad > 0 and 10 * #bad <= #session.looks then
    session = without(session, bad)
    made = believed:calibrate(session)
    run:note(("%d looks were left out"):format(#bad))
  end
  while not explained(made) and #made.outliers == 0 and factor < 3 do
    factor = factor + 0.5
    made = believed:calibrate(with_outlines(session, factor))
  end
  if factor == 1 and explained(made) then
    made, factor = nearer(believed, session, made)
  end
  run:result("session_outliers", #bad)
  run:result("session_outline_factor", factor)
  if explained(made) then
    if factor ~= 1 then run:note(("outlines are %.1f times as far from the model's as believed"):format(factor)) end
    made.outline = factor * chain.contour_sigma
    return made
  end
  local cause = made.status == "not_converged" and "the estimate did not come to rest"
    or #made.outliers > 0 and ("%d of its looks do not fit the others"):format(#made.outliers)
    or "no few looks are the cause: a number is measured wrongly, or the bench is not as its priors have it"
  local fit = ("chi square %.0f of %d degrees of freedom, at most %.0f"):format(
    made.chi2,
    made.degrees_of_freedom,
    made.chi2_limit
  )
  error(("the session does not fit any chain (%s): %s"):format(fit, cause), 0)
end

--- A table of what was learned of each parameter, the results of the session, and what would be measured best next.
function chain.report(run, made)
  local rows = {}
  for i, one in ipairs(made.chain:parameters()) do
    rows[i] = {
      one.parameter,
      ("%.4g"):format(one.off),
      ("%.2g"):format(one.sigma),
      ("%.2g"):format(one.prior_sigma),
      one.unit,
      ("%.0f %%"):format(100 * one.learned),
    }
  end
  run:table {
    title = "The viewing chain, off what was believed",
    header = { "parameter", "off", "sigma", "before", "unit", "learned" },
    rows = rows,
  }
  run:result("session_chi2_per_degree", made.chi2 / math.max(made.degrees_of_freedom, 1))
  run:result("explanations", #made.minima)
  for _, goal in ipairs { "depth", "height", "aside" } do
    local plan = made.chain:next { goal = goal, steps = 3 }
    run:result("calibration_part_of_" .. goal, plan.leaves_now, "m")
    local steps = {}
    for i, step in ipairs(plan.steps) do
      steps[i] = ("%s (%.0f um)"):format(step.measurement, step.leaves / um)
    end
    run:note(("%s: calibration leaves %.0f um; next: %s"):format(goal, plan.leaves_now / um, table.concat(steps, ", then ")))
  end
  if #made.minima > 1 then
    run:note(("%d chains explain the session equally: their difference is in every uncertainty"):format(#made.minima))
  end
  if #made.unobserved > 0 then run:note("not observed: " .. table.concat(made.unobserved, ", ")) end
end

--- Writes what chain.calibrate `made` to chain.json in the run's folder, as the rig's model.chain takes it, and installs it where
--- the rig names a file for that. `touched`: landings on the retina are in it; else a side camera's places. It is in force from
--- the next start on, for this eye and this robot, while the rig believes the same of scale and microscope.
function chain.install(rig, run, made, touched)
  local model, parameters = rig:model(), {}
  for i, one in ipairs(made.chain:parameters()) do
    parameters[i] = { name = one.parameter, off = one.off, sigma = one.prior_sigma }
  end
  local distance, tilt = model.microscope.pupil_distance, model.microscope.tilt
  local about = {
    eye = model.eye_name,
    robot = model.robot_name,
    plates = model.robot_plate_ratio < 1,
    pixel = model.pixel,
    center = { model.center_px[1], model.center_px[2] },
    pupil_power = distance and 1 / distance or 0,
    tilt = { tilt[1], tilt[2] },
  }
  files.write("chain.json", json.text {
    about = about,
    eye = model.eye_id,
    touched = touched,
    outline_px = made.outline,
    parameters = parameters,
    covariance = made.chain:covariance(),
  } .. "\n")
  local installed = run:install_calibration { values = {}, files = { ["model.chain"] = "chain.json" } }
  if installed then run:note("the next start locates by the chain that was measured, from " .. installed) end
end

--- Places in the workspace, evenly: `count` of a spiral within `reach` of the axis, from `low` to `high`, which are heights
--- over the retina. A list of positions in the world frame.
function chain.places(rig, count, reach, low, high)
  local eye, places = rig:model().eye_in_world, {}
  for i = 1, count do
    local part = (i - 0.5) / count
    local angle, radius = 2.39996 * i, reach * math.sqrt((i * 0.618034) % 1)
    places[i] = eye + vector(radius * math.cos(angle), radius * math.sin(angle), low + (high - low) * part)
  end
  return places
end

--- Where a chain puts the robot of a look, as viewing_chain:locate says it; nothing outside. `outline`: px, of each semi-axis
--- (`chain.contour_sigma`).
function chain.locate(calibrated, look, outline)
  return calibrated:locate {
    ellipse = { u = look.u, v = look.v, semi_major = look.semi_major, semi_minor = look.semi_minor, angle = look.angle },
    axis = look.axis,
    contour_sigma = outline or chain.contour_sigma,
  }
end

--- Refines a chain by frames of the run, `looks` that were taken at `times`. Records a row of the table "self_calibration": how
--- many frames are in it, what calibration leaves of height and depth, and whether the bench has changed. Returns what
--- viewing_chain:refine says.
function chain.refine(run, calibrated, looks, times)
  local made = calibrated:refine { looks = looks, times = times }
  run:record("self_calibration", {
    frames = made.frames,
    taken = made.taken,
    no_new = made.no_new,
    misfit = made.misfit,
    dropped = made.dropped,
    explanations = made.explanations,
    height = made.height,
    depth = made.depth,
    change_evidence = made.change_evidence,
  }, { height = "m", depth = "m" })
  return made
end

--- Judges a chain by new looks: {look =, place =} each, with the robot's place in the eye's frame by truth or side camera.
--- Returns errors in depth and aside, and the part of depths within their 95 % interval. `outline` as chain.locate has it.
function chain.judge(calibrated, looks, outline)
  local depth, aside, within, fits = {}, {}, 0, 0
  for _, one in ipairs(looks) do
    local found = chain.locate(calibrated, one.look, outline)
    if found then
      local error = found.position - one.place
      depth[#depth + 1], aside[#aside + 1] = math.abs(error.z), math.abs(error.x)
      if math.abs(error.z) < 1.96 * found.sigma.z then within = within + 1 end
      if found.status == "found" then fits = fits + 1 end
    end
  end
  return { depth = depth, aside = aside, covered = within / math.max(#depth, 1), fits = fits / math.max(#depth, 1) }
end

chain.workspace = { reach = 3 * mm, low = 2.5 * mm, high = 7.5 * mm }

return chain
