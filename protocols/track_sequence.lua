-- track_sequence: follows an object through a folder of images or a video, learned from a few images with masks (thesis 8).
-- Writes track.csv into the run; against a truth it reports the errors.
-- SPDX-License-Identifier: Apache-2.0
local files = require "files"
local units = require "units"
local vision = require "vision"
local deg = units.deg

-- The frames, one at a time: next() gives an image and its number, or nothing at the end. Numbers come from the files'
-- names where each has one of its own, else they count from 0. And how many there are, or nil where a video does not say.
local function open_frames(path)
  if not files.is_folder(path) then
    local video, at = vision.video { file = path }, -1
    return function()
      at = at + 1
      local image = video:read()
      if image then return image, at end
    end,
      video:info().frames
  end
  local list, seen, numbered = vision.images { folder = path }, {}, true
  if #list == 0 then error("images: there is no PNG, JPEG, TIFF or BMP in " .. path, 0) end
  for _, file in ipairs(list) do
    numbered = numbered and file.number ~= nil and not seen[file.number]
    if file.number then seen[file.number] = true end
  end
  local at = 0
  return function()
    at = at + 1
    local file = list[at]
    if file then return vision.image { file = file.file }, numbered and file.number or at - 1 end
  end,
    #list
end

local function number_cell(row, name, line)
  local value = row[name]
  if type(value) ~= "number" or value ~= value then
    error(("truth: row %d: %s: wants a number, got %s"):format(line, name, value == nil and "nothing" or tostring(value)), 0)
  end
  return value
end

local function visible_cell(row, line)
  local value = row.visible
  if value == nil then return 1 end
  if value == "true" or value == "True" then return 1 end
  if value == "false" or value == "False" then return 0 end
  value = number_cell(row, "visible", line)
  if value < 0 or value > 1 then error(("truth: row %d: visible: wants 0 to 1, got %g"):format(line, value), 0) end
  return value
end

-- Rows by frame: x, y, full axes, angle, visible. A hidden object's place may be left out.
local function read_truth(path, axes)
  local read = files.read_csv(path)
  local rows, names = read.rows, read.columns
  local has, truth, first, last = {}, {}, math.huge, -math.huge
  for _, name in ipairs(names) do
    has[name] = true
  end
  for _, name in ipairs { "frame", "cx", "cy" } do
    if not has[name] then error("truth: has no column " .. name .. "; it has " .. table.concat(names, ", "), 0) end
  end
  local twice = axes == "semi" and 2 or 1
  for i, row in ipairs(rows) do
    local frame, visible = number_cell(row, "frame", i), visible_cell(row, i)
    if truth[frame] then error(("truth: row %d: frame %g comes twice"):format(i, frame), 0) end
    local one = { visible = visible }
    if visible > 0 then
      one.x, one.y = number_cell(row, "cx", i), number_cell(row, "cy", i)
      one.major = row.A and twice * number_cell(row, "A", i)
      one.minor = row.B and twice * number_cell(row, "B", i)
      one.angle = row.phi_deg and number_cell(row, "phi_deg", i) * deg
    end
    truth[frame] = one
    first, last = math.min(first, frame), math.max(last, frame)
  end
  if first > last then error("truth: has no rows", 0) end
  return truth, first
end

-- What to add to a frame's number to get the truth's: 0 where they agree, else what makes the first ones meet, since
-- some count from 0 and some from 1.
local function offset_of(tracks, truth, first)
  local missing = 0
  for _, track in ipairs(tracks) do
    if not truth[track.frame] then missing = missing + 1 end
  end
  return missing == 0 and 0 or first - tracks[1].frame
end

local function show(value) return value and ("%.4f"):format(value) or "" end

-- The covariance of (x_px, y_px, major_px, minor_px, angle_deg), 25 numbers by rows.
local function covariance_text(track)
  if not track.covariance then return "" end
  local words = {}
  for i = 0, 4 do
    for j = 0, 4 do
      local value = track.covariance[5 * i + j + 1] / ((i == 4 and deg or 1) * (j == 4 and deg or 1))
      words[#words + 1] = ("%.6g"):format(value)
    end
  end
  return table.concat(words, " ")
end

-- Where a person pointed at the head's end: rows of name, x_px, y_px, into the entries of the training with those names.
local function point_at_tips(training, path)
  local by_name = {}
  for _, entry in ipairs(training) do
    by_name[entry.name] = entry
  end
  for i, row in ipairs(files.read_csv(path).rows) do
    local entry = by_name[row.name]
    if not entry then error(("tips: row %d: no training image has the name %s"):format(i, tostring(row.name)), 0) end
    entry.tip = { x_px = row.x_px, y_px = row.y_px }
  end
end

-- The last columns of track.csv where tips were taught.
local function head_cells(track)
  local tip = track.tip
  return table.concat({
    show(track.heading and track.heading / deg),
    show(tip and tip.x_px),
    show(tip and tip.y_px),
    tip and ("%.6g %.6g %.6g %.6g"):format(table.unpack(tip.covariance)) or "",
    tip and tostring(tip.seen) or "",
  }, ",")
end

local function write_tracks(tracks, with_head)
  local head = "frame,state,x_px,y_px,major_px,minor_px,angle_deg,covariance,microseconds"
  local lines = { head .. (with_head and ",heading_deg,tip_x_px,tip_y_px,tip_covariance,tip_seen" or "") }
  for _, t in ipairs(tracks) do
    lines[#lines + 1] = table.concat({
      ("%d"):format(t.frame),
      t.state,
      show(t.x_px),
      show(t.y_px),
      show(t.major_px),
      show(t.minor_px),
      show(t.angle and t.angle / deg),
      covariance_text(t),
      ("%.1f"):format(1e6 * t.cpu_time),
    }, ",") .. (with_head and "," .. head_cells(t) or "")
  end
  files.write("track.csv", table.concat(lines, "\n") .. "\n")
end

-- Sums of absolute errors over the frames where it was tracked and something of it could be seen.
local function compare(tracks, truth)
  local sum = { lost = 0, wrong = 0, frames = 0, center = 0, major = 0, minor = 0, angle = 0, tracked = 0, ratio = 0, inside = 0 }
  for _, t in ipairs(tracks) do
    local true_one = truth[t.frame]
    if true_one then
      sum.frames = sum.frames + 1
      local tracking = t.state == "tracking"
      if not tracking and true_one.visible >= 0.3 then sum.lost = sum.lost + 1 end
      if tracking and true_one.visible <= 0 then sum.wrong = sum.wrong + 1 end
      if tracking and true_one.visible > 0 then
        local dx, dy = t.x_px - true_one.x, t.y_px - true_one.y
        local off = math.sqrt(dx * dx + dy * dy)
        if off > 10 then sum.wrong = sum.wrong + 1 end
        sum.tracked, sum.center = sum.tracked + 1, sum.center + off
        local c = t.covariance
        local det = c[1] * c[7] - c[2] * c[6]
        -- chi^2 of two at 95 %
        if (c[7] * dx * dx - 2 * c[2] * dx * dy + c[1] * dy * dy) / det < 5.991 then sum.inside = sum.inside + 1 end
        if true_one.major and true_one.minor and true_one.angle then
          sum.shapes = (sum.shapes or 0) + 1
          sum.major = sum.major + math.abs(t.major_px - true_one.major)
          sum.minor = sum.minor + math.abs(t.minor_px - true_one.minor)
          sum.ratio = sum.ratio + t.major_px / true_one.major
          local turn = math.abs(t.angle - true_one.angle) % math.pi
          sum.angle = sum.angle + math.min(turn, math.pi - turn)
        end
      end
    end
  end
  return sum
end

local function judge(run, tracks, p)
  local truth, first = read_truth(p.truth, p.truth_axes)
  local offset = offset_of(tracks, truth, first)
  if offset ~= 0 then
    run:note(("the truth's frames count from %d, the images' from %d: taken as the same"):format(first, tracks[1].frame))
    for _, t in ipairs(tracks) do
      t.frame = math.tointeger(t.frame + offset) or t.frame + offset
    end
  end
  local sum = compare(tracks, truth)
  if sum.frames == 0 then error("truth: none of its frames is among the images", 0) end
  run:result("frames_judged", sum.frames)
  run:result("lost", sum.lost)
  run:result("wrong", sum.wrong)
  if sum.tracked > 0 then
    run:result("center_error_mean", sum.center / sum.tracked)
    run:result("inside_95_percent", sum.inside / sum.tracked)
  end
  if sum.shapes then
    run:result("major_error_mean", sum.major / sum.shapes)
    run:result("minor_error_mean", sum.minor / sum.shapes)
    run:result("angle_error_mean", sum.angle / sum.shapes, "deg")
    if p.truth_axes == "full" and sum.ratio / sum.shapes > 1.7 then
      run:note("the truth's A looks like a semi-axis: truth_axes=semi would double A and B")
    end
  end
end

local function color_table(run, training)
  local rows = {}
  for _, rank in ipairs(vision.rank_channels { images = training }) do
    rows[#rows + 1] = { rank.channels, ("%.2f"):format(rank.mean), ("%.2f"):format(rank.deviation) }
  end
  run:table {
    title = "Quality (8.1) of every pair of channels, as thesis table 8.2",
    header = { "channels", "mean r", "deviation" },
    rows = rows,
  }
end

local function plots(run, tracks)
  local frames, x, y, time = {}, {}, {}, {}
  for i, t in ipairs(tracks) do
    frames[i], x[i], y[i], time[i] = t.frame, t.x_px or 0 / 0, t.y_px or 0 / 0, t.cpu_time
  end
  run:plot {
    title = "Where it was seen",
    x = { "frame", "" },
    y = { "px", "" },
    series = { { label = "x", x = frames, y = x }, { label = "y", x = frames, y = y, mark = "dashed" } },
  }
  run:plot {
    title = "CPU time of a frame",
    x = { "frame", "" },
    y = { "time", "us" },
    series = { { label = "tracker", x = frames, y = time, mark = "points" } },
  }
end

return {
  title = "Track a sequence of images",
  needs = {},
  parameters = {
    images = { required = true, help = "a folder of PNG frames, or a video file" },
    training = { required = true, help = "a folder of images NAME.png with masks NAME_mask.png" },
    network = { default = "", help = "learned evidence beside the colors, such as networks/evidence.onnx" },
    tips = { default = "", help = "csv: name, x_px, y_px: where the head ends in training images, for heading and tip" },
    truth = { default = "", help = "csv: frame, cx, cy, A, B, phi_deg, visible" },
    truth_axes = { choices = { "full", "semi" }, default = "full", help = "what A and B of the truth are" },
    channels = { default = "RGB", help = "that the color model looks at: RGB, or a pair such as RG, YV, HS" },
    mixed = { default = 0, min = 0, max = 1, help = "share of colors that defocus would mix: 0.1 follows a body out of focus" },
    shape_prior = { default = true, help = "draw the outline to the shapes learnt" },
    refine = { default = true, help = "the rim to a fraction of a pixel" },
    pictures = { default = 8, min = 0, max = 100, integer = true, help = "frames shown in the report" },
  },
  run = function(rig, p, run)
    local next_frame, count = open_frames(p.images)
    local training = vision.training { folder = p.training }
    if p.tips ~= "" then point_at_tips(training, p.tips) end
    local network = p.network ~= "" and p.network or nil
    local model = vision.color_model { images = training, channels = p.channels, mixed = p.mixed, network = network }
    model:save("object.model")
    local quality = model:info().quality
    run:note(("learnt from %d images: quality %.2f +- %.2f"):format(#training, quality.mean, quality.deviation))
    color_table(run, training)
    local tracker = vision.tracker { model = model, shape_prior = p.shape_prior, refine = p.refine }
    local every = p.pictures > 0 and math.max((count or 0) // p.pictures, 1) or math.huge
    local tracks, trail, cpu, shown = {}, {}, 0, 0
    local image, frame = next_frame()
    while image do
      local seen = tracker:update(image)
      local track = seen.tracks[1]
      track.frame, track.cpu_time = frame, seen.cpu_time
      tracks[#tracks + 1], cpu = track, cpu + seen.cpu_time
      if track.x_px then trail[#trail + 1] = { track.x_px, track.y_px } end
      if #trail > 60 then table.remove(trail, 1) end
      if (#tracks - 1) % every == 0 and shown < p.pictures then
        shown = shown + 1
        run:picture {
          title = ("frame %d"):format(frame),
          image = image:overlay {
            track = track,
            expected = track.expected,
            trail = trail,
            caption = ("%d %s"):format(frame, track.state),
          },
          note = track.state,
        }
      end
      if count then run:progress(math.min(#tracks / count, 1), "frame " .. #tracks) end
      image, frame = next_frame()
    end
    if #tracks == 0 then error("images: there is no frame in " .. p.images, 0) end
    if p.truth ~= "" then judge(run, tracks, p) end
    write_tracks(tracks, p.tips ~= "")
    local tracked = 0
    for _, t in ipairs(tracks) do
      tracked = tracked + (t.x_px and 1 or 0)
    end
    run:result("frames", #tracks)
    run:result("tracked", tracked)
    run:result("frames_per_second", #tracks / cpu)
    plots(run, tracks)
  end,
}
