-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, its Modbus table. Addresses are as on the wire, from 0: a manual's 40001 is often register 0.
return {
  title = "@NAME@",
  kind = "actuator",
  measures = "temperature", -- protocols may ask for "a actuator of temperature"
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "\x03\x00\x00\x00\x01", match = "^\x03\x02" }, -- it has no name: register 0 answers
  make_safe = { set_point = 20 }, -- however a run ends
  -- type: u16, i16, u32, i32, f32 or flag; table: holding (the usual), input, coil, discrete_input; scale: unit of its last
  -- digit; words = "low_first" where the low half of two registers comes first.
  properties = {
    temperature = { unit = "degC", register = 0, type = "i16", scale = 0.1, every = 1 }, -- asked by itself, and recorded
    set_point = { unit = "degC", register = 1, type = "i16", scale = 0.1, set = true, min = 0, max = 60 },
  },
  -- By the names of properties, in their units; what is written stands in the state e.
  emulator = {
    registers = { set_point = 20, temperature = function(e) return e.set_point end },
  },
}
