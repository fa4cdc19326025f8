-- JSON of numbers, texts, booleans, lists and tables, for other programs. A number that is not finite (NaN, infinity) is null.
-- SPDX-License-Identifier: Apache-2.0
local json = {}

local short = { ['"'] = '\\"', ["\\"] = "\\\\", ["\n"] = "\\n", ["\r"] = "\\r", ["\t"] = "\\t" }

local function quoted(text)
  return '"' .. text:gsub('[%c"\\]', function(c) return short[c] or ("\\u%04x"):format(c:byte()) end) .. '"'
end

local function number(value)
  if value ~= value or math.abs(value) == math.huge then return "null" end
  if math.type(value) == "integer" then return tostring(value) end
  return ("%.17g"):format(value)
end

--- A value as JSON, its keys in alphabetical order; a table with something at 1, and an empty one, is a list.
function json.text(value)
  local kind = type(value)
  if kind == "nil" then return "null" end
  if kind == "boolean" then return tostring(value) end
  if kind == "number" then return number(value) end
  if kind == "string" then return quoted(value) end
  if kind ~= "table" then error("json: cannot write a " .. kind, 2) end
  local parts = {}
  if value[1] ~= nil or next(value) == nil then
    for i = 1, #value do
      parts[i] = json.text(value[i])
    end
    return "[" .. table.concat(parts, ",") .. "]"
  end
  local keys = {}
  for key in pairs(value) do
    keys[#keys + 1] = key
  end
  table.sort(keys)
  for i, key in ipairs(keys) do
    parts[i] = quoted(key) .. ":" .. json.text(value[key])
  end
  return "{" .. table.concat(parts, ",") .. "}"
end

return json
