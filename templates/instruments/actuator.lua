-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
-- What a rig file may say beside driver and address; in the file `set.highest` has the value, in this unit.
local set = settings {
  highest = { default = 60, unit = "degC", min = 0, max = 200, help = "to which it may be set" },
}

return {
  title = "@NAME@",
  kind = "actuator",
  measures = "temperature", -- protocols may ask for "a actuator of temperature"
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  make_safe = { "OUT 0" }, -- however a run ends
  errors = { ask = "ERR?", none = "^0" }, -- asked after each command
  -- rig.@NAME@:set_point(), rig.@NAME@:set_set_point(310): in SI there, in these units here. What is set has bounds.
  properties = {
    set_point = { unit = "degC", ask = "SETP?", set = "SETP %.2f", min = 0, max = set.highest },
    temperature = { unit = "degC", ask = "TEMP?", every = 1, help = "of the bath; asked by itself each second, and recorded" },
    on = { type = "flag", ask = "OUT?", set = function(io, on) io:send(on and "OUT 1" or "OUT 0") end },
  },
  -- The instrument's end, for rigs with address = "emulated" and for the tests: what it answers, or a function of its state e.
  emulator = {
    start = function(e)
      e.set_point, e.on = 20, "0"
    end,
    answers = {
      ["*IDN?"] = "ACME,BATH,1,1.0",
      ["ERR?"] = "0",
      ["SETP?"] = function(e) return ("%.2f"):format(e.set_point) end,
      ["TEMP?"] = function(e) return ("%.2f"):format(e.on == "1" and e.set_point or 20) end,
      ["OUT?"] = function(e) return e.on end,
      { "^SETP (.+)$", function(e, value) e.set_point = tonumber(value) end },
      { "^OUT ([01])$", function(e, on) e.on = on end },
    },
  },
}
