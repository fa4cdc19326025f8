-- Declarations of a protocol's tests: the entries of its `tests`, which `vitreo test` reads. Each is plain data.
-- SPDX-License-Identifier: Apache-2.0
local testing = {}

local function entry(kind, given, known)
  if type(given) ~= "table" then error("test_" .. kind .. ": wants a table, got " .. type(given), 3) end
  local made = { test = kind }
  for key, value in pairs(given) do
    if not known[key] then error(("test_%s: %s is not known"):format(kind, tostring(key)), 3) end
    if type(value) ~= known[key] then error(("test_%s: %s: wants a %s, got %s"):format(kind, key, known[key], type(value)), 3) end
    made[key] = value
  end
  return made
end

--- A run that completes; `results` = { name = { least, most } } in SI. `arguments` and `answers` as on the command line, blanks
--- between; `rig` a name in scripts/rigs/ or a file.
function testing.test_run(options)
  return entry("run", options, { arguments = "string", answers = "string", rig = "string", seed = "number", results = "table" })
end

--- A run that does not complete, and is safe: with `fault` (as run --fault takes it; `vitreo faults` lists them) or with
--- arguments that it must refuse; `outcome` ("aborted", "failed", "refused": any that is not completed), and `says`, a part of
--- the reason.
function testing.test_fail(options)
  return entry("fail", options, {
    arguments = "string",
    answers = "string",
    rig = "string",
    seed = "number",
    fault = "string",
    outcome = "string",
    says = "string",
  })
end

--- A run that is stopped `times` (100) times at moments drawn by chance: each ends as stopped, and safe.
function testing.test_stop(options)
  return entry(
    "stop",
    options or {},
    { arguments = "string", answers = "string", rig = "string", seed = "number", times = "number" }
  )
end

return testing
