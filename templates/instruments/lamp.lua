-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
return {
  title = "@NAME@",
  kind = "lamp",
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  set_level = function(io, level) io:send(("LEVEL %.3f"):format(level)) end, -- 0 is dark, 1 is full
  make_safe = { "LEVEL 0" }, -- however a run ends
  rescue = { identify = { "*IDN?", "ACME" }, send = { "LEVEL 0" } }, -- what the guardian sends when the host is dead
  -- The instrument's end, for rigs with address = "emulated" and for the tests.
  emulator = {
    answers = { ["*IDN?"] = "ACME,LAMP,1,1.0", { "^LEVEL (.+)$", function(e, level) e.level = tonumber(level) end } },
  },
}
