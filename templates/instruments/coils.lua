-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
local CHANNELS = 8

local function listed(currents)
  local texts = {}
  for channel = 1, CHANNELS do
    texts[channel] = ("%.4f"):format(currents[channel])
  end
  return table.concat(texts, ",")
end
local function currents(text)
  local list = {}
  for number in text:gmatch("[^,]+") do
    list[#list + 1] = tonumber(number)
  end
  return list
end
local ZERO = currents(("0,"):rep(CHANNELS))

return {
  title = "@NAME@",
  kind = "coils",
  channels = CHANNELS, -- of the amplifier, each drives one coil
  current_limit = 5, -- A, of each channel
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  set_currents = function(io, list) io:send("CURR " .. listed(list)) end, -- A, one a channel; within the limit
  measured_currents = function(io) return currents(io:ask("MEAS?")) end,
  make_safe = { "CURR " .. listed(ZERO) }, -- however a run ends
  -- What the guardian sends when the host is dead: no Lua runs then. identify: a question, and what its answer begins with;
  -- check: questions, and the answers that prove it.
  rescue = { identify = { "*IDN?", "ACME" }, send = { "CURR " .. listed(ZERO) }, check = { "MEAS?", listed(ZERO) } },
  -- The instrument's end, for rigs with address = "emulated" and for the tests; e.currents flow in the simulated coils.
  emulator = {
    start = function(e) e.currents = ZERO end,
    answers = {
      ["*IDN?"] = "ACME,COILS,1,1.0",
      ["MEAS?"] = function(e) return listed(e.currents) end,
      { "^CURR (.+)$", function(e, list) e.currents = currents(list) end },
    },
  },
}
