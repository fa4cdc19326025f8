-- Color images of the robot in the eye with its known outline in each, for training and judging trackers (thesis 8). On a
-- simulated rig the robot is brought to positions and steered by the simulator's pose sensor in place of the operator; its
-- outline is the projection of its true pose, in place of segmentation by hand.
-- SPDX-License-Identifier: Apache-2.0
local statistics = require "analysis.statistics"
local units = require "units"
local mm, s, deg = units.mm, units.s, units.deg
local color_scene = {}

-- The truth nearest to a time.
local function truth_at(run, time)
  local channels = { "x", "y", "z", "axis_x", "axis_y", "axis_z" }
  local truth = run:samples("truth", channels, { from = time - 0.15 * s, to = time + 0.15 * s })
  if not truth then error("this rig has no truth to judge by", 0) end
  local times, best = truth.time, nil
  for i = 1, #times do
    if not best or math.abs(times[i] - time) < math.abs(times[best] - time) then best = i end
  end
  if not best then return nil end
  return vector(truth.x[best], truth.y[best], truth.z[best]), vector(truth.axis_x[best], truth.axis_y[best], truth.axis_z[best])
end

--- The outline that the robot has in a frame: {x_px, y_px, major_px, minor_px, angle}, full axes; nothing when it is not there.
function color_scene.outline(rig, run, frame, view)
  local position, axis = truth_at(run, frame.time)
  if not position then return nil end
  local model = rig:model()
  local seen = (view or rig:view()):ellipse { body = model.robot, position = position - model.eye_in_world, axis = axis }
  return seen
    and { x_px = seen.u, y_px = seen.v, major_px = 2 * seen.semi_major, minor_px = 2 * seen.semi_minor, angle = seen.angle }
end

--- A `position` where a robot of 2 mm is well in sight, and an `axis` not too near the view's, from the run's seed.
function color_scene.somewhere()
  local angle, aside = 2 * math.pi * math.random(), 2.5 * mm * math.sqrt(math.random())
  local place = vector(aside * math.cos(angle), aside * math.sin(angle), -2 * mm + 4 * mm * math.random())
  local turn, tilt = 2 * math.pi * math.random(), 0.5 * (math.random() - 0.5)
  local axis = vector(math.cos(turn) * math.cos(tilt), math.sin(turn) * math.cos(tilt), math.sin(tilt))
  return { position = place, axis = axis }
end

-- Holds the robot at a place with its axis along a direction, until it is there.
local function hold(rig, run, place, axis)
  run:wait(0.2 * s) -- its currents must not follow the last loop's at once
  local servo = rig:servo { feedback = "pose_sensor", law = "estimator", axis = axis, lost_timeout = 5 * s }
  servo:hold(place)
  rig.sample:insert_robot(place)
  servo:wait_until_tracked()
  return servo
end

--- `count` frames at places all over the field, as {image =, mask =, outline =}: to train with.
function color_scene.training(rig, run, count)
  local made, view = {}, rig:view()
  while #made < count do
    local pose = color_scene.somewhere()
    local servo <close> = hold(rig, run, pose.position, pose.axis) -- luacheck: ignore servo
    run:wait(0.6 * s)
    local frame = rig.top_camera:grab { fresh = true }
    run:wait(0.2 * s)
    local outline = color_scene.outline(rig, run, frame, view)
    if outline then
      made[#made + 1] = {
        image = frame.image,
        mask = frame.image:ellipse_mask(outline),
        outline = outline,
        name = ("%02d"):format(#made + 1),
      }
    end
    rig.sample:remove_robot()
    run:progress(#made / count, ("training image %d of %d"):format(#made, count))
  end
  return made
end

--- Frames while the robot goes round: some paths, each with another direction of its axis. look(frame, arriving) is called for
--- each. `arriving`: the robot has just been put at the beginning of a path, as no robot gets there by itself. A tracker has to
--- see these frames, to find it anew and believe its find; they are not to be judged.
function color_scene.watch(rig, run, legs, speed, look)
  for number, leg in ipairs(legs) do
    local servo <close> = hold(rig, run, leg.points[1], leg.axis)
    local there = run:now()
    while run:now() < there + 0.6 * s do
      look(rig.top_camera:grab(), true)
    end
    local going = true
    run:together(function()
      servo:follow(leg.points, {
        speed = speed,
        acceleration = 10 * mm / s ^ 2,
        label = ("leg %d of %d"):format(number, #legs),
      })
      going = false
    end, function()
      while going do
        look(rig.top_camera:grab())
      end
    end)
    rig.sample:remove_robot()
  end
end

--- Legs across the field, from the run's seed.
function color_scene.legs(count)
  local made = {}
  for k = 1, count do
    local from, to = color_scene.somewhere(), color_scene.somewhere()
    made[k] = { points = { from.position, to.position }, axis = from.axis }
  end
  return made
end

--- Mean absolute differences of tracks from outlines: x, y, major, minor in px, angle in rad, as table 8.3; and how many were
--- lost or wrong (over 20 px off).
function color_scene.compare(pairs_of)
  local sums, count, lost, wrong = { 0, 0, 0, 0, 0 }, 0, 0, 0
  for _, one in ipairs(pairs_of) do
    local track, outline = one.track, one.outline
    if track.state ~= "tracking" then
      lost = lost + 1
    elseif math.abs(track.x_px - outline.x_px) > 20 or math.abs(track.y_px - outline.y_px) > 20 then
      wrong = wrong + 1
    else
      local turn = math.abs(track.angle - outline.angle) % math.pi
      local off = {
        math.abs(track.x_px - outline.x_px),
        math.abs(track.y_px - outline.y_px),
        math.abs(track.major_px - outline.major_px),
        math.abs(track.minor_px - outline.minor_px),
        math.min(turn, math.pi - turn),
      }
      for i = 1, 5 do
        sums[i] = sums[i] + off[i]
      end
      count = count + 1
    end
  end
  local means = statistics.map(sums, function(sum) return count > 0 and sum / count or 0 / 0 end)
  return {
    x = means[1],
    y = means[2],
    major = means[3],
    minor = means[4],
    angle = means[5],
    tracked = count,
    lost = lost,
    wrong = wrong,
  }
end

--- A table of what `compare` found: one row a tracker, each with `name` and `errors`.
function color_scene.tell(run, title, trackers)
  local function px(value) return value == value and ("%.2f"):format(value) or "–" end
  run:table {
    title = title .. "; lost: said so, wrong: over 20 px off",
    header = { "tracker", "x, px", "y, px", "A, px", "B, px", "angle, °", "tracked", "lost", "wrong" },
    rows = statistics.map(trackers, function(one)
      local e = one.errors
      local off = statistics.map({ e.x, e.y, e.major, e.minor, e.angle / deg }, px)
      return { one.name, off[1], off[2], off[3], off[4], off[5], tostring(e.tracked), tostring(e.lost), tostring(e.wrong) }
    end),
  }
end

return color_scene
