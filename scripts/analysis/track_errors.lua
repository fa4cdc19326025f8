-- Errors of a recorded track along one axis at a time, against the simulator's truth or the side camera, as thesis table 5.4.
-- SPDX-License-Identifier: Apache-2.0
local judge = require "analysis.path_accuracy"
local statistics = require "analysis.statistics"
local track_errors = {}

--- |stream - reference| along an axis ("x", "z") in a span {from, to}, at the stream's times; frames without a place are left
--- out. The reference is read at its nearest sample. Returns {errors, times}, and of the loop's own positions `sigmas`, what was
--- stated of each.
function track_errors.along(run, axis, span, options)
  options = options or {}
  local stream, prefix = options.stream or "servo", options.prefix or ""
  local reference = options.reference or judge.reference(run)
  local judged_by = run:samples(reference, { axis }, { from = math.max(span.from - 1, 0), to = span.to + 1 })
  local stated = stream == "servo" and prefix == "" and "sigma_" .. axis
  local seen = run:samples(stream, { prefix .. axis, stated or nil }, { from = span.from, to = span.to })
  local truth, truth_times, values, times = judged_by[axis], judged_by.time, seen[prefix .. axis], seen.time
  local errors, at, sigmas, near = {}, {}, {}, 1
  for i = 1, #values do
    while near < #truth and math.abs(truth_times[near + 1] - times[i]) <= math.abs(truth_times[near] - times[i]) do
      near = near + 1
    end
    local off = truth[near] and values[i] - truth[near]
    if off and off == off then
      errors[#errors + 1], at[#at + 1] = math.abs(off), times[i]
      if stated then sigmas[#sigmas + 1] = seen[stated][i] end
    end
  end
  return { errors = errors, times = at, sigmas = sigmas }
end

--- Of a track of track_errors.along: the part of its errors within 1.96 of what was stated of each, 95 % where the statement is
--- right. Errors of a bench are common to its places: many benches tell, not many places.
function track_errors.within_95(track)
  local within = 0
  for i, one in ipairs(track.errors) do
    if one < 1.96 * track.sigmas[i] then within = within + 1 end
  end
  return within / math.max(#track.errors, 1)
end

--- mean, deviation, max of a list of errors; an error when there are none.
function track_errors.statistics(errors)
  if #errors == 0 then error("the robot was not localized in this span", 2) end
  return {
    mean = statistics.mean(errors),
    deviation = statistics.deviation(errors),
    max = statistics.max(errors),
    count = #errors,
  }
end

return track_errors
