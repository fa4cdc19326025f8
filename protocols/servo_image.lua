-- Image-based visual servoing (thesis 6.2: "these experiments could also be conducted as image-based visual servoing using the
-- projection model and the detected microrobot"): the error is taken in the image, of the outline's center and width, and the
-- projection model's Jacobian turns it into a motion. The places are taught by being shown: an image of the robot there is the
-- target, and the robot comes back to where it looks the same, in an eye that the model does not know as well as it could.
-- SPDX-License-Identifier: Apache-2.0
local bring = require "session.preparation"
local expect = require "analysis.expectations"
local eyes = require "session.eyes"
local judge = require "analysis.path_accuracy"
local statistics = require "analysis.statistics"
local units = require "units"
local mm, um, s, mT = units.mm, units.um, units.s, units.mT

local center = vector(0, 0, 0)
local taught_places = { vector(2, 0, 0), vector(0, 1.5, 1), vector(-2, -1, 0), vector(1, 0, -1.5) } -- mm
local channels = { "u_px", "v_px", "semi_minor_px" }

-- The features of the outline, the mean over the last `span` s: {u, v, b} in px; nil while it is not seen.
local function features(run, span)
  local seen, mean = run:samples("servo", channels, { from = run:now() - span, to = run:now() }), {}
  for k, channel in ipairs(channels) do
    local good = {}
    for _, value in ipairs(seen[channel]) do
      if value == value then good[#good + 1] = value end
    end
    if #good == 0 then return nil end
    mean[k] = statistics.mean(good)
  end
  return mean
end

-- The believed features of the robot at a place of the eye, by the projection model.
local function projected(view, robot, place)
  local seen = view:ellipse { body = robot, position = place, axis = vector(1, 0, 0) }
  return seen and { seen.u, seen.v, seen.semi_minor } or nil
end

-- J = d(u, v, b) / d(x, y, z), by differences of 0.1 mm: its columns; nil at the end of the view.
local function jacobian(view, robot, place)
  local columns, step = {}, 0.1 * mm
  for k = 1, 3 do
    local off = vector(k == 1 and step or 0, k == 2 and step or 0, k == 3 and step or 0)
    local above, below = projected(view, robot, place + off), projected(view, robot, place - off)
    if not (above and below) then return nil end
    columns[k] =
      vector((above[1] - below[1]) / (2 * step), (above[2] - below[2]) / (2 * step), (above[3] - below[3]) / (2 * step))
  end
  return columns
end

-- J m = e by Cramer's rule.
local function solved(columns, e)
  local function triple(a, b, c) -- a . (b x c)
    return a[1] * (b[2] * c[3] - b[3] * c[2]) + a[2] * (b[3] * c[1] - b[1] * c[3]) + a[3] * (b[1] * c[2] - b[2] * c[1])
  end
  local a, b, c = columns[1], columns[2], columns[3]
  local volume = triple(a, b, c)
  if math.abs(volume) < 1e-12 then return nil end
  return vector(triple(e, b, c) / volume, triple(a, e, c) / volume, triple(a, b, e) / volume)
end

-- Until the image is the target's, or the time is over: every frame a part of the motion that the image asks for, no faster than
-- `speed`. Returns the last error in the image, px.
local function servo_to_image(run, servo, view, model, target, p)
  local goal, until_when, last = servo:status().position or center, run:now() + p.time, nil
  local period = 1 / 15
  while run:now() < until_when do
    run:wait(period)
    local now, place = features(run, 3 * period), servo:status().position
    local columns = now and place and jacobian(view, model.robot, place - model.eye_in_world)
    if columns then
      last = vector(target[1] - now[1], target[2] - now[2], target[3] - now[3])
      local motion = solved(columns, last)
      if motion then
        local most = p.speed * period
        motion = motion * (p.gain * period)
        if motion:norm() > most then motion = motion * (most / motion:norm()) end
        local wanted = goal + motion
        if pcall(servo.hold, servo, wanted) then goal = wanted end -- one out of reach is left out
      end
    end
  end
  return last
end

-- Where the robot is, by what the run is judged by: the mean over the last `span` s.
local function judged_place(run, span)
  local reference = judge.reference(run)
  local seen = run:samples(
    reference,
    reference == "truth" and { "x", "y", "z" } or { "x", "z" },
    { from = run:now() - span, to = run:now() }
  )
  local function mean(list)
    local good = {}
    for _, value in ipairs(list or {}) do
      if value == value then good[#good + 1] = value end
    end
    return #good > 0 and statistics.mean(good) or 0
  end
  return vector(mean(seen.x), mean(seen.y), mean(seen.z))
end

return {
  title = "Image-based servoing",
  needs = { "top_camera", "coils", "sample" },
  rig = "unknown_eye",
  parameters = {
    places = { default = 4, min = 1, max = 4, integer = true, help = "that are taught and found again" },
    time = { unit = "s", default = 25 * s, min = 2 * s, max = 300 * s, help = "for the way back to each" },
    speed = { unit = "mm/s", default = 0.5 * mm / s, min = 0.05 * mm / s, max = 2 * mm / s, help = "at most" },
    gain = { unit = "Hz", default = 0.5, min = 0.05, max = 2, help = "part of the image's error that is taken back in a second" },
    field = { unit = "mT", default = 10 * mT, min = 2 * mT, max = 30 * mT, help = "magnitude of the magnetic field" },
    eye = eyes.parameter "perturbed",
    draw = eyes.draw,
  },
  run = function(rig, p, run)
    rig.sample:remove_robot()
    local truth = eyes.differs(p.eye) and eyes.set(rig, run, p.eye, p.draw) or nil
    local background = rig:learn_background { frames = 15 }
    local servo <close> = rig:servo { background = background, law = "estimator", field = p.field }
    local view, model = rig:view(), rig:model()
    bring.insert(rig, servo, center)
    local taught = {}
    for number = 1, p.places do
      run:checkpoint("before place " .. number .. " is taught")
      servo:go_to(taught_places[number] * mm, { speed = p.speed, within = 1 * mm, settle = 2 * s })
      run:wait(2 * s)
      local image = features(run, 2 * s)
      if not image then error(("place %d: the robot is not seen"):format(number), 0) end
      taught[number] = { image = image, place = judged_place(run, 2 * s), believed = servo:position() }
    end
    local rows, image_errors, place_errors = {}, {}, {}
    for number in run:each(p.places, "place") do
      run:checkpoint("before the way back to place " .. number)
      servo_to_image(run, servo, view, model, taught[number].image, p)
      local image = features(run, 1 * s)
      local off = image and vector(image[1], image[2], image[3]) - vector(table.unpack(taught[number].image)) or nil
      local apart = judged_place(run, 1 * s) - taught[number].place
      image_errors[number], place_errors[number] = off and off:norm() or 0 / 0, apart:norm()
      servo:snapshot("back at place " .. number)
      rows[number] = {
        tostring(number),
        off and ("%.2f, %.2f"):format(off[1], off[2]) or "not seen",
        off and ("%.2f"):format(off[3]) or "–",
        format_quantity(apart:norm(), "m"),
        format_quantity((taught[number].place - taught[number].believed):norm(), "m"),
      }
    end
    local _, reference = judge.reference(run)
    run:table {
      title = "Back where the robot looks as it was shown; the last column: what the view's model is off by there",
      header = { "place", "image: center, px", "width, px", "from the place shown, by the " .. reference, "localization off by" },
      rows = rows,
    }
    eyes.report(run, rig:eye(), truth)
    run:result("image_error_median", statistics.median(image_errors), "")
    run:result("place_error_median", statistics.median(place_errors), "m")
    local book = expect.book(run, "6.2")
    book:number {
      id = "6.2.image_error",
      what = "image-based: error of the outline's center and width at the end, largest, px",
      ours = statistics.max(image_errors),
      at_most = 1,
      reason = "this project's goal; the thesis names the way and did not go it",
    }
    book:number {
      id = "6.2.place_error",
      what = "image-based: from the place that was shown, largest",
      ours = statistics.max(place_errors),
      unit = "m",
      at_most = 100 * um,
      reason = "this project's goal",
    }
    book:close()
  end,
}
