-- Acceptance limits of the calibrations, shared by calibrate_rig and the protocols of its parts. A protocol may pass its own
-- for those that an operator may choose.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, ms, s, deg, uT, mT = units.mm, units.ms, units.s, units.deg, units.uT, units.mT
local limits = {}

limits.pixel = 0.02 -- by which a pixel may differ from what is believed, relative
limits.rotation = 1 * deg
limits.pupil_power = 6 -- 1/m: a pupil at 170 mm, nearer than any microscope's with room for an eye
limits.telecentric = 100 -- m, of a pupil: as good as none
limits.tilt = 3 * deg -- of a microscope
limits.residual_px = 0.5 -- rms, that a camera's fit may leave
limits.distortion = 0.01 -- at the grid's corner, relative
limits.delay = 30 * ms -- by which the coils' delay may differ from what is believed: three sigmas of the simulated plant's
limits.bandwidth = { 1, 1000 } -- Hz
limits.age = 0.4 * s -- of a frame when it arrives
limits.field = 0.01 -- that the field's fit may leave, relative
limits.field_largest = 1 * mT
limits.background = 500 * uT
limits.robot = { least = 0.4, most = 2.5, sigma = 0.15 } -- of drag and moment, over what outline and volume say
-- Of calibrate_field: the velocity that a model leaves is this part of what it was, or already as small as another calibration
-- would leave it; a coil differs by five sigmas of how far two calibrations of one machine do.
limits.by_motion = { better = 0.7, unexplained = 30 * units.um / s, gain = 0.15, angle = 8 * deg }
limits.grid = 3 * mm -- half the width of the cameras' grid

--- A camera's fit (calibrations.camera) against what is believed of it; `own`: pixel, residual_px.
function limits.camera(book, role, fit, pixel, own)
  own = own or {}
  local off = own.pixel or limits.pixel
  book:check {
    name = role .. ": pixel",
    part = role,
    key = role .. ".effective_pixel",
    believed = pixel,
    value = fit.pixel,
    sigma = fit.pixel_sigma,
    unit = "m",
    least = (1 - off) * pixel,
    most = (1 + off) * pixel,
  }
  book:check {
    name = role .. ": rotation",
    part = role,
    believed = 0,
    value = fit.rotation,
    sigma = fit.rotation_sigma,
    unit = "rad",
    least = -limits.rotation,
    most = limits.rotation,
  }
  book:check {
    name = role .. ": what the fit leaves, px rms",
    part = role,
    value = fit.rms_residual_px,
    least = 0,
    most = own.residual_px or limits.residual_px,
  }
  book:check {
    name = role .. ": distortion at the corner",
    part = role,
    believed = 0,
    value = fit.distortion,
    least = -limits.distortion,
    most = limits.distortion,
  }
end

--- A microscope's fit (calibrations.microscope) against what the rig believes, `model`.
function limits.microscope(book, fit, model)
  local part, distance = "microscope", model.microscope.pupil_distance
  book:check {
    name = "top_camera: pixel",
    part = part,
    key = "top_camera.effective_pixel",
    believed = model.pixel,
    value = fit.pixel,
    sigma = fit.pixel_sigma,
    unit = "m",
    least = (1 - limits.pixel) * model.pixel,
    most = (1 + limits.pixel) * model.pixel,
  }
  book:check {
    name = "microscope: 1 / pupil distance",
    part = part,
    believed = distance and 1 / distance or 0,
    value = fit.pupil_power,
    sigma = fit.pupil_power_sigma,
    unit = "1/m",
    least = -3 * fit.pupil_power_sigma,
    most = limits.pupil_power,
  }
  -- A telecentric one has its pupil farther away than a rig file can say.
  local found = 1 / math.max(fit.pupil_power, 1 / limits.telecentric)
  book:check {
    name = "microscope: pupil distance",
    part = part,
    key = "top_camera.microscope.pupil_distance",
    believed = distance,
    value = found,
    sigma = fit.pupil_power_sigma * found ^ 2,
    unit = "m",
    least = 1 / limits.pupil_power,
    most = limits.telecentric,
  }
  for i, axis in ipairs { "x", "y" } do
    book:check {
      name = "microscope: tilt about " .. axis,
      part = part,
      believed = model.microscope.tilt[i],
      value = fit.tilt[i],
      sigma = fit.tilt_sigma[i],
      unit = "rad",
      least = -limits.tilt,
      most = limits.tilt,
    }
  end
  book:check {
    name = "microscope: what the fit leaves, px rms",
    part = part,
    value = fit.rms_residual_px,
    least = 0,
    most = limits.residual_px,
  }
end

--- Delay and time constant of the coils, `step` of calibrations.coil_latency; `own`: delay, sigma.
function limits.coil_latency(book, model, step, own)
  own = own or {}
  local off = own.delay or limits.delay
  book:check {
    name = "coils: delay",
    part = "latency",
    key = "model.coil_delay",
    believed = model.command_delay,
    value = step.delay,
    sigma = own.sigma,
    unit = "s",
    least = model.command_delay - off,
    most = model.command_delay + off,
  }
  book:check {
    name = "coils: bandwidth",
    part = "latency",
    key = "model.coil_bandwidth",
    believed = model.command_bandwidth,
    value = 1 / (2 * math.pi * step.constant),
    unit = "Hz",
    least = limits.bandwidth[1],
    most = limits.bandwidth[2],
  }
end

--- How old a camera's frames are when they arrive (calibrations.camera_latency).
function limits.frames(book, role, age)
  book:check {
    name = role .. ": age of its frames",
    value = age.mean,
    sigma = age.deviation,
    unit = "s",
    least = 0,
    most = limits.age,
  }
end

--- What the fit of the coils' field says (calibrations.field); `own`: field. The model is kept in `file` when all is well.
function limits.coils(book, told, file, own)
  local well = book:check {
    name = "coils: residual, relative",
    value = told.residual_relative,
    least = 0,
    most = own and own.field or limits.field,
  }
  well = book:check {
    name = "coils: residual, largest",
    value = told.residual_largest,
    unit = "T",
    least = 0,
    most = limits.field_largest,
  } and well
  well = book:check {
    name = "coils: background",
    value = vector(told.background):norm(),
    unit = "T",
    least = 0,
    most = limits.background,
  } and well
  well = book:check { name = "coils: the fit converged", value = told.converged and 1 or 0, least = 1, most = 1 } and well
  if well then book:keep("model.calibration", file) end
  return well
end

return limits
