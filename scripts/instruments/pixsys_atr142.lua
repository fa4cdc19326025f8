-- Pixsys ATR142 temperature controller: Modbus RTU, tenths of a degree.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Pixsys ATR142 user's manual, Modbus table (1000: the process value, 1001: the set point). A set point is kept
-- in an EEPROM, which wears out: do not make ramps by setting it.
local set = settings {
  unit = { default = 247, min = 1, max = 247, help = "its Modbus address" },
  highest = { default = 100, unit = "degC", min = 0, max = 1200, help = "to which it may be set" },
  safe = { default = 0, unit = "degC", min = 0, max = 100, help = "its set point when it must be safe: it has no off" },
}

return {
  title = "Pixsys ATR142 temperature controller",
  kind = "actuator",
  measures = "temperature",
  link = { baud_rate = 19200, modbus = { unit = set.unit } },
  identity = { ask = "\x03\x03\xE8\x00\x01", match = "^\x03\x02" }, -- it has no name: its register answers
  make_safe = { set_point = set.safe },
  properties = {
    temperature = { unit = "degC", register = 1000, type = "i16", scale = 0.1, every = 1 },
    set_point = { unit = "degC", register = 1001, type = "i16", scale = 0.1, set = true, min = 0, max = set.highest },
  },
  emulator = {
    registers = { set_point = 20, temperature = function(e) return e.set_point end },
  },
}
