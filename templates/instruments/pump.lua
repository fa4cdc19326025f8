-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
-- What a rig file may say beside driver and address; in the file `set.highest` has the value, in this unit.
local set = settings {
  highest = { default = 10, unit = "mL/min", min = 0.01, max = 1000, help = "rate that may be set" },
}

return {
  title = "@NAME@",
  kind = "pump",
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  make_safe = { "STOP" }, -- however a run ends
  properties = {
    rate = { unit = "mL/min", ask = "RATE?", set = "RATE %.3f", min = 0, max = set.highest, help = "of its flow" },
  },
  -- rig.@NAME@:dispense(2e-6) returns when `done` says so: it is asked again and again, and may be stopped between.
  commands = {
    dispense = {
      send = "PUMP %.3f",
      arguments = { { name = "volume", unit = "mL", min = 0.001, max = 100 } },
      lasts = 600, -- s, at most
      done = function(io) return io:ask("BUSY?") == "0" end,
    },
  },
  -- The instrument's end, for rigs with address = "emulated" and for the tests: what it answers, or a function of its state e.
  emulator = {
    start = function(e) e.rate = 1 end,
    answers = {
      ["*IDN?"] = "ACME,PUMP,1,1.0",
      ["RATE?"] = function(e) return ("%.3f"):format(e.rate) end,
      ["BUSY?"] = function(e) return e:gliding("volume") and "1" or "0" end,
      ["STOP"] = function(e) e:glide("volume", e:at("volume"), 1) end,
      { "^RATE (.+)$", function(e, rate) e.rate = tonumber(rate) end },
      { "^PUMP (.+)$", function(e, volume) e:glide("volume", e:at("volume") + tonumber(volume), e.rate / 60) end },
    },
  },
}
