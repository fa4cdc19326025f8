-- Maps the retina live: each frame is found on the map as it comes, the map grows where the view leaves it, and with a color
-- model the robot's path is told in the retina's own coordinates, whatever the eye does.
-- SPDX-License-Identifier: Apache-2.0
local statistics = require "analysis.statistics"
local units = require "units"
local vision = require "vision"
local s = units.s

-- Where the robot is on the map, with the standard deviation of both: nothing where either is not known.
local function on_map(map, pose, track)
  if not pose or track.state ~= "tracking" then return nil end
  local at = map:to_map(track.x_px, track.y_px)
  local own = math.sqrt((track.covariance[1] + track.covariance[7]) / 2)
  return { x = at.x_px, y = at.y_px, sigma = math.sqrt(own ^ 2 + pose.sigma_px ^ 2) }
end

-- Share and times of the frames that were found, as results and a plot.
local function results(run, found)
  local times = statistics.map(found.poses, function(pose) return pose.cpu_time end)
  run:result("frames", found.frames)
  run:result("frames_on_map", #found.poses)
  run:result("map_frames", found.map_frames)
  run:result("frame_time_median", statistics.median(times), "s")
  run:result("frame_time_longest", statistics.percentile(times, 1), "s")
  run:result("sigma_median", statistics.median(statistics.map(found.poses, function(pose) return pose.sigma_px end)))
  run:plot {
    title = "Where the view was on the map",
    x = { "time", "s" },
    y = { "px", "" },
    series = {
      { label = "x", x = found.time, y = statistics.map(found.poses, function(pose) return pose.x_px end) },
      { label = "y", x = found.time, y = statistics.map(found.poses, function(pose) return pose.y_px end) },
    },
  }
  if #found.robot == 0 then return end
  run:plot {
    title = "The robot on the retina",
    x = { "x, px", "" },
    y = { "y, px", "" },
    series = {
      {
        label = "path",
        x = statistics.map(found.robot, function(at) return at.x end),
        y = statistics.map(found.robot, function(at) return at.y end),
      },
    },
  }
end

return {
  title = "Map of the retina",
  needs = { "top_camera" },
  rig = "drifting_eye",
  parameters = {
    duration = { unit = "s", default = 10 * s, min = 1 * s, max = 3600 * s, help = "how long it looks" },
    model = { default = "", help = "a file that color_model:save wrote: the robot is told on the map, and left out of it" },
    pictures = { default = 4, min = 0, max = 50, integer = true, help = "stabilized frames in the report" },
  },
  run = function(rig, p, run)
    local map = vision.retina_map {}
    local tracker = p.model ~= "" and vision.tracker { model = vision.color_model { file = p.model } } or nil
    local found = { frames = 0, poses = {}, time = {}, robot = {} }
    local begin, shown = run:now(), 0
    while run:now() - begin < p.duration do
      local frame = rig.top_camera:grab()
      local track = tracker and tracker:update(frame.image).tracks[1] or nil
      local pose = map:update(frame.image, { body = track and track.x_px and track or nil })
      found.frames = found.frames + 1
      local row = { x_px = 0 / 0, y_px = 0 / 0, angle = 0 / 0, scale = 0 / 0, sigma_px = 0 / 0 }
      if pose then
        found.poses[#found.poses + 1], found.time[#found.time + 1] = pose, frame.time
        row = { x_px = pose.x_px, y_px = pose.y_px, angle = pose.angle, scale = pose.scale, sigma_px = pose.sigma_px }
      end
      run:record("retina", row)
      local robot = track and on_map(map, pose, track)
      if robot then
        found.robot[#found.robot + 1] = robot
        run:record("robot_on_retina", { x_px = robot.x, y_px = robot.y, sigma_px = robot.sigma })
      end
      local part = (run:now() - begin) / p.duration
      if pose and shown < p.pictures * part then
        shown = shown + 1
        run:picture { title = ("stabilized, at %.1f s"):format(frame.time), image = map:stabilize(frame.image) }
      end
      run:progress(math.min(part, 0.99), ("%d of %d frames on the map"):format(#found.poses, found.frames))
    end
    if #found.poses == 0 then error("there is no frame that shows a retina", 0) end
    local picture = map:picture()
    found.map_frames = picture.frames
    run:picture { title = "The map", image = picture.image, note = ("%d frames"):format(picture.frames) }
    picture.image:save("map.png")
    results(run, found)
    run:headline(("%d of %d frames found on a map of %d"):format(#found.poses, found.frames, picture.frames))
  end,
}
