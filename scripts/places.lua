-- Named places of the workspace, world frame, m.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm = units.mm
local places = {}

-- The retina of the simulated rig's model eye: its vertex at z = -5 mm, its radius.
local retina = { center = vector(0, 0, 6.5 * mm), radius = 11.5 * mm }

--- Whether a robot of 2 mm there is well inside the eye, and where the top camera of that rig sees all of it.
function places.in_sight(position)
  local aside = (position[1] ^ 2 + position[2] ^ 2) ^ 0.5
  return (position - retina.center):norm() < retina.radius - 1.1 * mm and aside < 4 * mm and position[3] < 4 * mm
end

-- The six of thesis table 6.1. The thesis names them and gives no coordinates; these are assumed: as far out as a robot that
-- is placed by hand, to a millimeter, stays in sight and clear of the retina of the model eye.
places.six = {
  { name = "upper-middle", position = vector(0, 0, 3 * mm), edge = false },
  { name = "middle-middle", position = vector(0, 0, 0), edge = false },
  { name = "lower-middle", position = vector(0, 0, -2.5 * mm), edge = false },
  { name = "upper-right", position = vector(3.5 * mm, 0, 3 * mm), edge = true },
  { name = "middle-right", position = vector(3.5 * mm, 0, 0), edge = true },
  { name = "lower-right", position = vector(3.5 * mm, 0, -2.5 * mm), edge = true },
}

-- Thesis table 6.1, um/s: mean of five runs with constant currents, one camera, two cameras.
places.table_6_1 = {
  ["upper-middle"] = { none = 264, one_camera = 53, two_cameras = 106 },
  ["middle-middle"] = { none = 258, one_camera = 82, two_cameras = 101 },
  ["lower-middle"] = { none = 159, one_camera = 62, two_cameras = 62 },
  ["upper-right"] = { none = 486, one_camera = 140, two_cameras = 147 },
  ["middle-right"] = { none = 609, one_camera = 178, two_cameras = 207 },
  ["lower-right"] = { none = 495, one_camera = 129, two_cameras = 208 },
}

return places
