-- HCP TC038D temperature controller (an oven of a nonlinear crystal): Modbus RTU, registers of four bytes, in tenths.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: PyMeasure tc038d.py (0x0000: the temperature, 0x0106: the set point).
local set = settings {
  unit = { default = 1, min = 1, max = 247, help = "its Modbus address" },
  highest = { default = 150, unit = "degC", min = 0, max = 300, help = "to which it may be set" },
  safe = { default = 20, unit = "degC", min = 0, max = 100, help = "its set point when it must be safe: it has no off" },
}

return {
  title = "HCP TC038D temperature controller",
  kind = "actuator",
  measures = "temperature",
  link = { baud_rate = 9600, modbus = { unit = set.unit } },
  identity = { ask = "\x03\x00\x00\x00\x02", match = "^\x03\x04" }, -- it has no name: its register answers
  make_safe = { set_point = set.safe },
  properties = {
    temperature = { unit = "degC", register = 0x0000, type = "i32", scale = 0.1, every = 1 },
    set_point = { unit = "degC", register = 0x0106, type = "i32", scale = 0.1, set = true, min = 0, max = set.highest },
  },
  emulator = {
    registers = { set_point = 20, temperature = function(e) return e.set_point end },
  },
}
