-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
return {
  title = "@NAME@",
  kind = "sensor",
  measures = "temperature", -- protocols may ask for "a sensor of temperature"
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  -- rig.@NAME@:value() asks for it. A number is the first one in the answer; `answer` is a pattern for another part of it.
  properties = {
    value = { unit = "degC", ask = "TEMP?", every = 1, help = "of the bath" }, -- every: asked by itself, and recorded; s
  },
  -- The instrument's end, for rigs with address = "emulated" and for the tests: what it answers, or a function of its state e.
  emulator = {
    answers = { ["*IDN?"] = "ACME,SENSOR,1,1.0", ["TEMP?"] = "21.50" },
  },
}
