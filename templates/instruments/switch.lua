-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
return {
  title = "@NAME@",
  kind = "switch",
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  make_safe = { on = false }, -- however a run ends: a property and its value, or messages, or a function(io)
  -- rig.@NAME@:set_on(true)
  properties = {
    on = { type = "flag", ask = "OUT?", set = function(io, on) io:send(on and "OUT 1" or "OUT 0") end },
  },
  -- The instrument's end, for rigs with address = "emulated" and for the tests: what it answers, or a function of its state e.
  emulator = {
    start = function(e) e.on = "0" end,
    answers = {
      ["*IDN?"] = "ACME,SWITCH,1,1.0",
      ["OUT?"] = function(e) return e.on end,
      { "^OUT ([01])$", function(e, on) e.on = on end },
    },
  },
}
