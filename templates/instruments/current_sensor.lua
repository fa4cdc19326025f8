-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
return {
  title = "@NAME@",
  kind = "current_sensor",
  coils = { 1, 2 }, -- which coils of the rig it measures, in the order of its answer
  unit = "A", -- of what `measure` returns
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  measure = function(io)
    local first, second = io:ask("CURR?"):match("^([^,]+),([^,]+)$")
    if not first then io:fail("protocol", "it does not tell two currents") end
    return { tonumber(first), tonumber(second) }
  end,
  -- The instrument's end, for rigs with address = "emulated" and for the tests.
  emulator = {
    answers = { ["*IDN?"] = "ACME,SENSOR,1,1.0", ["CURR?"] = "0.000,0.000" },
  },
}
