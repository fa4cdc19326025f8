-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
return {
  title = "@NAME@",
  kind = "instrument",
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  -- Any names: rig.@NAME@:mode(), rig.@NAME@:set_mode("fast"), rig.@NAME@:zero().
  properties = {
    mode = { choices = { fast = "1", slow = "2" }, ask = "MODE?", set = "MODE %s" }, -- a name, and what it calls it
    voltage = { unit = "V", ask = "VOLT?", every = 1 },
  },
  commands = {
    zero = { send = "ZERO", expects = "^OK$", help = "take what it reads now for zero" }, -- expects: it answers a command
  },
  -- The instrument's end, for rigs with address = "emulated" and for the tests: what it answers, or a function of its state e.
  emulator = {
    start = function(e) e.mode = "1" end,
    answers = {
      ["*IDN?"] = "ACME,METER,1,1.0",
      ["MODE?"] = function(e) return e.mode end,
      ["VOLT?"] = "0.125",
      ["ZERO"] = "OK",
      { "^MODE ([12])$", function(e, mode) e.mode = mode end },
    },
  },
}
