-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
return {
  title = "@NAME@",
  kind = "interlock_input",
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  properties = {
    closed = { type = "flag", ask = "FLOW?", every = 0.1, help = "the water flows" }, -- false, or no answer: the outputs go off
  },
  -- The instrument's end, for rigs with address = "emulated" and for the tests: what it answers, or a function of its state e.
  emulator = {
    answers = { ["*IDN?"] = "ACME,CHILLER,1,1.0", ["FLOW?"] = "1" },
  },
}
