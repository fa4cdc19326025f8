-- First-order optics of a lens by the matrices of thesis (4.2) to (4.9): its focal length and principal points, as figure 4.4
-- shows them for an eye with a condensing lens.
-- SPDX-License-Identifier: Apache-2.0
local first_order = {}

-- Rows of a prescription lie from the retina outwards; the medium of one is behind it, towards the observer.
local function product(a, b)
  return {
    { a[1][1] * b[1][1] + a[1][2] * b[2][1], a[1][1] * b[1][2] + a[1][2] * b[2][2] },
    { a[2][1] * b[1][1] + a[2][2] * b[2][1], a[2][1] * b[1][2] + a[2][2] * b[2][2] },
  }
end

local function index_of(row) return row.index or 1 end

--- The matrix of the surfaces `first` to `last` of a prescription's rows, on {n angle, height}: A = R2 T21 R1, (4.5), (4.9).
function first_order.matrix(rows, first, last)
  local all = { { 1, 0 }, { 0, 1 } }
  for i = first, last do
    local power = rows[i].radius and (index_of(rows[i]) - index_of(rows[i - 1])) / rows[i].radius or 0
    all = product({ { 1, -power }, { 0, 1 } }, all) -- (4.2), (4.3)
    if i < last then all = product({ { 1, 0 }, { rows[i].thickness / index_of(rows[i]), 1 } }, all) end -- (4.4)
  end
  return all
end

--- Focal length (4.6), and the principal points from the first and from the last vertex, (4.7) and (4.8), in m:
--- {focal_length, first, second}.
function first_order.points(rows, first, last)
  local a = first_order.matrix(rows, first, last)
  return {
    focal_length = -1 / a[1][2],
    first = index_of(rows[first - 1]) * (1 - a[1][1]) / -a[1][2],
    second = index_of(rows[last]) * (a[2][2] - 1) / -a[1][2],
  }
end

return first_order
