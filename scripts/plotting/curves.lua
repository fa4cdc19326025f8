-- Families of curves for plots: a NaN lifts the pen between them.
-- SPDX-License-Identifier: Apache-2.0
local curves = {}

--- One series of many curves: draw(value) gives {r = {...}, z = {...}} for each value. x of the plot is z.
function curves.family(label, values, draw, mark)
  local all = { label = label, mark = mark, x = {}, y = {} }
  for _, value in ipairs(values) do
    local curve = draw(value)
    for i = 1, #curve.r do
      all.x[#all.x + 1], all.y[#all.y + 1] = curve.z[i], curve.r[i]
    end
    all.x[#all.x + 1], all.y[#all.y + 1] = 0 / 0, 0 / 0
  end
  return all
end

--- c0 + c1 x + c2 x^2 + c3 x^3.
function curves.cubic(c, x) return c[1] + x * (c[2] + x * (c[3] + x * c[4])) end

--- Values of one field of a list of tables.
function curves.field(list, name)
  local values = {}
  for i, one in ipairs(list) do
    values[i] = one[name]
  end
  return values
end

return curves
