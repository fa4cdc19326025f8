-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, its Modbus table. Addresses are as on the wire, from 0: a manual's 40001 is often register 0.
return {
  title = "@NAME@",
  kind = "sensor",
  measures = "temperature", -- protocols may ask for "a sensor of temperature"
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "\x03\x00\x00\x00\x01", match = "^\x03\x02" }, -- it has no name: register 0 answers
  -- type: u16, i16, u32, i32, f32 or flag; table: holding (the usual), input, coil, discrete_input; scale: unit of its last
  -- digit; words = "low_first" where the low half of two registers comes first.
  properties = {
    value = { unit = "degC", register = 0, type = "i16", scale = 0.1, every = 1 }, -- asked by itself each second, and recorded
  },
  -- By the names of properties, in their units; what is written stands in the state e.
  emulator = {
    registers = { value = 21.5 },
  },
}
