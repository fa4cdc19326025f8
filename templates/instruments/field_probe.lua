-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
-- What a rig file may say beside driver and address; in the file `set.range` has the value, in this unit.
local set = settings {
  range = { default = 1, unit = "T", min = 0.001, max = 30, help = "largest field that it measures" },
}

return {
  title = "@NAME@",
  kind = "field_probe",
  axis_count = 3, -- or 1
  range = set.range, -- T; a larger reading is an error
  unit = "T", -- of what `measure` returns
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  setup = { "UNIT T" }, -- sent once it is known
  measure = function(io)
    local x, y, z = io:ask("FIELD?"):match("^([^,]+),([^,]+),([^,]+)$")
    if not x then io:fail("protocol", "it does not tell three fields") end
    return { tonumber(x), tonumber(y), tonumber(z) }
  end,
  -- The instrument's end, for rigs with address = "emulated" and for the tests; e.field is the field at the probe.
  emulator = {
    answers = {
      ["*IDN?"] = "ACME,PROBE,1,1.0",
      ["FIELD?"] = function(e)
        local field = e.field or { 0, 0, 0 }
        return ("%.7f,%.7f,%.7f"):format(field[1], field[2], field[3])
      end,
      ["UNIT T"] = function() end,
    },
  },
}
