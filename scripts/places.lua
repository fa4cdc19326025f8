-- Named places of the workspace, world frame, m.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm = units.mm
local places = {}

-- The retina of the simulated rig's model eye: its vertex at z = -5 mm, its radius.
local retina = { center = vector(0, 0, 6.5 * mm), radius = 11.5 * mm }

--- Whether a robot of 2 mm there is well inside the eye, and not farther aside than `aside`.
function places.in_sight(position, aside)
  local off = (position[1] ^ 2 + position[2] ^ 2) ^ 0.5
  return (position - retina.center):norm() < retina.radius - 1.4 * mm and off < aside and position[3] < 4 * mm
end

--- The six of thesis table 6.1. The thesis names them and gives no coordinates; these are assumed: the edge `edge` aside, and
--- below it as deep as a robot that is placed by hand, to a millimeter, stays clear of the retina of the model eye; `room`
--- (0, m) higher where the retina is known less well (retina.room).
function places.six(edge, room)
  local aside = retina.radius - 1.8 * mm
  local lowest = math.max(-2.5 * mm, retina.center[3] - (aside ^ 2 - edge ^ 2) ^ 0.5) + (room or 0)
  return {
    { name = "upper-middle", position = vector(0, 0, 3 * mm), edge = false },
    { name = "middle-middle", position = vector(0, 0, 0), edge = false },
    { name = "lower-middle", position = vector(0, 0, -2.5 * mm), edge = false },
    { name = "upper-right", position = vector(edge, 0, 3 * mm), edge = true },
    { name = "middle-right", position = vector(edge, 0, 0), edge = true },
    { name = "lower-right", position = vector(edge, 0, lowest), edge = true },
  }
end

-- Thesis table 6.1, um/s: mean and standard deviation of five runs with constant currents, one camera, two cameras.
places.table_6_1 = {
  ["upper-middle"] = { none = { 264, 15 }, one_camera = { 53, 14 }, two_cameras = { 106, 15 } },
  ["middle-middle"] = { none = { 258, 193 }, one_camera = { 82, 47 }, two_cameras = { 101, 68 } },
  ["lower-middle"] = { none = { 159, 9 }, one_camera = { 62, 6 }, two_cameras = { 62, 19 } },
  ["upper-right"] = { none = { 486, 11 }, one_camera = { 140, 10 }, two_cameras = { 147, 10 } },
  ["middle-right"] = { none = { 609, 4 }, one_camera = { 178, 2 }, two_cameras = { 207, 8 } },
  ["lower-right"] = { none = { 495, 53 }, one_camera = { 129, 2 }, two_cameras = { 208, 4 } },
}

return places
