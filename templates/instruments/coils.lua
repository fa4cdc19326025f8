-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
return {
  title = "@NAME@",
  kind = "coils",
  channels = 2, -- of the amplifier, each drives one coil
  current_limit = 5, -- A, of each channel
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  set_currents = function(io, currents) -- A, one a channel; within the limit
    io:send(("CURR %.4f,%.4f"):format(currents[1], currents[2]))
  end,
  measured_currents = function(io)
    local first, second = io:ask("MEAS?"):match("^([^,]+),([^,]+)$")
    if not first then io:fail("protocol", "it does not tell two currents") end
    return { tonumber(first), tonumber(second) }
  end,
  make_safe = { "CURR 0,0" }, -- however a run ends
  -- What the guardian sends when the host is dead: no Lua runs then. identify: a question, and what its answer begins with;
  -- check: questions, and the answers that prove it.
  rescue = { identify = { "*IDN?", "ACME" }, send = { "CURR 0,0" }, check = { "MEAS?", "0.0000,0.0000" } },
  -- The instrument's end, for rigs with address = "emulated" and for the tests; e.currents flow in the simulated coils.
  emulator = {
    start = function(e) e.currents = { 0, 0 } end,
    answers = {
      ["*IDN?"] = "ACME,COILS,1,1.0",
      ["MEAS?"] = function(e) return ("%.4f,%.4f"):format(e.currents[1], e.currents[2]) end,
      { "^CURR ([^,]+),(.+)$", function(e, a, b) e.currents = { tonumber(a), tonumber(b) } end },
    },
  },
}
