-- Tracks the robot in the eye by color, in three pairs of channels, with and without the two thresholds (thesis 8.3.3, table
-- 8.3, figures 8.7 and 8.9), and reports the error of each against the true outline.
-- SPDX-License-Identifier: Apache-2.0
local color_scene = require "session.color_scene"
local expect = require "analysis.expectations"
local published = require "analysis.published"
local units = require "units"
local vision = require "vision"
local mm, s = units.mm, units.s

-- One tracker a way of looking: the thesis' level set with its thresholds or one at 0, and ours with the refined rim.
local function trackers(training, pairs_of)
  local made = {}
  for _, channels in ipairs(pairs_of) do
    local model = vision.color_model { images = training, channels = channels }
    local limits = published.thresholds[channels]
    made[#made + 1] = {
      channels = channels,
      name = channels .. ", one threshold",
      tracker = vision.tracker { model = model, shape_prior = false, refine = false, threshold_low = 0, threshold_high = 0 },
    }
    made[#made + 1] = {
      channels = channels,
      name = channels .. ", thesis' thresholds",
      thesis = true,
      tracker = vision.tracker {
        model = model,
        shape_prior = false,
        refine = false,
        threshold_low = limits[1],
        threshold_high = limits[2],
      },
    }
    made[#made + 1] =
      { channels = channels, name = channels .. ", shape and rim", ours = true, tracker = vision.tracker { model = model } }
  end
  return made
end

-- 8.3.5: lower thresholds, so that all of the robot is found with some of the ground, which the shape then discards.
local function with_and_without_shape(training)
  local model, made = vision.color_model { images = training, channels = "RG" }, {}
  for _, prior in ipairs { false, true } do
    made[#made + 1] = {
      channels = "low RG",
      name = "RG, low thresholds, " .. (prior and "color and shape" or "color alone"),
      tracker = vision.tracker { model = model, shape_prior = prior, refine = false, threshold_low = 0, threshold_high = 0.6 },
    }
  end
  return made
end

-- Mean error of the center, px; a frame that was lost or wrong counts as one of 20 px, from which a frame is wrong.
local function failure_of(one)
  local e = one.errors
  local bad = e.lost + e.wrong
  local off = e.tracked > 0 and math.sqrt(e.x ^ 2 + e.y ^ 2) * e.tracked or 0
  return (off + 20 * bad) / (e.tracked + bad)
end

local function lost_part(one)
  local e = one.errors
  return (e.lost + e.wrong) / (e.tracked + e.lost + e.wrong)
end

-- The order of table 8.3 and what figures 8.7 and 8.9 show, of the thesis' own way of tracking: the level set with thresholds.
local function judge_order(book, all)
  local by = {}
  for _, one in ipairs(all) do
    by[one.name] = one
  end
  local function of(channels, way) return by[channels .. ", " .. way] end
  local limits, plain = "thesis' thresholds", "one threshold"
  book:number {
    id = "8.3.order",
    what = "thesis' thresholds: error of Y-U over the larger of R-G and Y-V",
    ours = failure_of(of("YU", limits)) / math.max(failure_of(of("RG", limits)), failure_of(of("YV", limits))),
    thesis = math.sqrt(3.72 ^ 2 + 9.3 ^ 2) / math.sqrt(2.03 ^ 2 + 2.2 ^ 2),
    at_least = 1,
    printed = true,
    reason = "Y-U is the worst of the three",
    why = "another scene; a frame lost or wrong counts as 20 px",
  }
  book:number {
    id = "8.7.RG",
    what = "R-G: frames lost or wrong with thresholds less those without",
    where = "figure 8.7",
    ours = lost_part(of("RG", limits)) - lost_part(of("RG", plain)),
    at_most = 0,
    printed = true,
    reason = '"thresholding increases the tracking robustness"',
  }
  book:number {
    id = "8.7.HS",
    what = "H-S with thresholds: part of the frames lost or wrong",
    where = "figure 8.7",
    ours = lost_part(of("HS", limits)),
    at_least = 0.5,
    printed = true,
    reason = '"the thresholds result in the tracker losing the microrobot"',
  }
  book:number {
    id = "8.9.shape",
    what = "R-G, low thresholds: error of the long axis with shape over that of color alone",
    where = "figure 8.9",
    ours = of("RG, low thresholds", "color and shape").errors.major / of("RG, low thresholds", "color alone").errors.major,
    at_most = 1,
    printed = true,
    reason = '"when shape information is incorporated the results are improved"',
  }
end

-- The outline that was found, unless there was none, beside the true one.
local function seen(track, outline)
  local marks = { { label = "true outline", ellipse = outline, dashed = true } }
  if track.x_px then table.insert(marks, 1, { label = "tracked", ellipse = track }) end
  return marks
end

return {
  title = "Tracking in the eye by color",
  simulated_only = true,
  needs = { "top_camera" },
  rig = "color_eye",
  parameters = {
    channels = { choices = { "all", "RG", "YV", "YU", "HS" }, default = "all", help = "pairs of channels of table 8.3, and H-S" },
    images = { default = 24, min = 3, max = 1000, integer = true, help = "to train with" },
    legs = {
      default = 6,
      min = 1,
      max = 100,
      integer = true,
      help = "ways across the field, each with another direction of the robot",
    },
    speed = { unit = "mm/s", default = 1 * mm / s, min = 0.05 * mm / s, max = 3 * mm / s, help = "along them" },
    judged = { default = 40, min = 1, max = 10000, integer = true, help = "equally spaced frames, as the thesis'" },
  },
  run = function(rig, p, run)
    local training = color_scene.training(rig, run, p.images)
    local all = trackers(training, p.channels == "all" and { "RG", "YV", "YU", "HS" } or { p.channels })
    if p.channels == "all" then
      for _, one in ipairs(with_and_without_shape(training)) do
        all[#all + 1] = one
      end
    end
    local frames = {}
    color_scene.watch(rig, run, color_scene.legs(p.legs), p.speed, function(frame, arriving)
      local looked = { time = frame.time, tracks = {} }
      for i, one in ipairs(all) do
        looked.tracks[i] = one.tracker:update(frame.image).tracks[1]
      end
      if arriving then return end
      frames[#frames + 1] = looked
      if #frames % 60 == 1 then looked.image = frame.image end
    end)
    run:wait(0.3 * s)
    local view, judged = rig:view(), {}
    local every = math.max(#frames // p.judged, 1)
    for k = 1, #frames do
      local outline = (k % every == 0 or frames[k].image) and color_scene.outline(rig, run, frames[k], view)
      if outline then judged[#judged + 1] = { frame = frames[k], outline = outline } end
    end
    if #judged == 0 then error("there is no frame to judge by", 0) end
    for i, one in ipairs(all) do
      local both = {}
      for k, each in ipairs(judged) do
        both[k] = { track = each.frame.tracks[i], outline = each.outline }
      end
      one.errors = color_scene.compare(both)
    end
    color_scene.tell(run, ("Mean errors in %d frames, as table 8.3"):format(#judged), all)
    for _, each in ipairs(judged) do
      if each.frame.image then
        for i, one in ipairs(all) do
          if one.ours and one.channels == all[1].channels then
            run:picture {
              title = ("at %.1f s, %s"):format(each.frame.time, one.name),
              image = each.frame.image,
              marks = seen(each.frame.tracks[i], each.outline),
            }
          end
        end
      end
    end
    local book = expect.book(run, "table 8.3")
    for _, one in ipairs(all) do
      local thesis = published.table_8_3[one.channels]
      if one.ours and thesis then
        -- One that was never tracked has no errors: the row of its lost frames says so.
        for k, name in ipairs(one.errors.tracked > 0 and { "x", "y", "major", "minor", "angle" } or {}) do
          book:number {
            id = ("8.3.%s.%s"):format(one.channels, name),
            what = ("%s: mean error of %s"):format(one.name, name),
            thesis = thesis[k],
            ours = one.errors[name],
            unit = name == "angle" and "rad" or "",
            why = "in px, full axes; another scene, drawn by the simulator, with the truth in the place of segmentation by hand: "
              .. "not the same error",
          }
        end
        book:number {
          id = ("8.3.%s.lost"):format(one.channels),
          what = one.name .. ": part of the frames lost or wrong",
          ours = (one.errors.lost + one.errors.wrong) / #judged,
          at_most = 0.05,
          reason = "one frame in twenty",
        }
      end
    end
    if p.channels == "all" then judge_order(book, all) end
    book:close()
  end,
}
