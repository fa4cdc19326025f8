-- Paths as lists of waypoints, for servo:follow. Positions are in the world frame, in m: x to the right of the top image,
-- z up towards the top camera.
-- SPDX-License-Identifier: Apache-2.0
local paths = {}

--- The corners of a rectangle in the vertical plane y = center.y, closed, from the lower left one: right, up, left, down.
function paths.rectangle(options)
  local center = options.center or vector(0, 0, 0)
  local half_width, half_depth = options.width / 2, options.depth / 2
  local corners = {
    vector(center[1] - half_width, center[2], center[3] - half_depth),
    vector(center[1] + half_width, center[2], center[3] - half_depth),
    vector(center[1] + half_width, center[2], center[3] + half_depth),
    vector(center[1] - half_width, center[2], center[3] + half_depth),
  }
  local points = { corners[1] }
  for _ = 1, options.laps or 1 do
    for corner = 2, 4 do
      points[#points + 1] = corners[corner]
    end
    points[#points + 1] = corners[1]
  end
  return points
end

--- The largest rectangle up to the one asked for (options as paths.rectangle has them, and `speed`) that the servo takes, in
--- steps of a twentieth, and three quarters of it at least: of a bench that was set up by hand retina and view stand where
--- they may be. Returns its corners, and the part of it that it is. Where a part is left out the record says why.
function paths.largest_rectangle(run, servo, options)
  local why
  for part = 20, 15, -1 do
    local corners = paths.rectangle {
      width = options.width * part / 20,
      depth = options.depth * part / 20,
      center = options.center,
      laps = options.laps,
    }
    local refused = servo:refusal(corners, { speed = options.speed })
    if not refused then
      if why then run:note(("the square is %d %% of what was asked for: %s"):format(5 * part, why)) end
      return corners, part / 20
    end
    why = why or refused
  end
  error(why, 0)
end

--- The corners of a square, as paths.rectangle gives them.
function paths.square(options)
  return paths.rectangle {
    width = options.side,
    depth = options.side,
    center = options.center,
    laps = options.laps,
  }
end

--- The length of the way along the points, in m.
function paths.length(points)
  local length = 0
  for i = 2, #points do
    length = length + (vector(points[i]) - points[i - 1]):norm()
  end
  return length
end

return paths
