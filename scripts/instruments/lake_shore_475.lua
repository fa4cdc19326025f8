-- Lake Shore 475 DSP gaussmeter, one axis, on RS-232.
-- SPDX-License-Identifier: Apache-2.0
-- Source: Lake Shore 475 user's manual, chapter 6: commands without an error queue, 7 bits and odd parity.
local set = settings {
  probe_range = { default = 3.5, unit = "T", min = 0.01, max = 35, help = "largest field of the probe" },
}

local function field(io) return tonumber(io:ask("RDGFIELD?")) or io:fail("protocol", "no field") end

return {
  title = "Lake Shore 475 gaussmeter",
  kind = "field_probe",
  axis_count = 1,
  range = set.probe_range,
  unit = "T",
  link = { baud_rate = 9600, data_bits = 7, parity = "odd", terminator = "\r\n", pause = 0.05 },
  identity = { ask = "*IDN?", match = "^LSCI,MODEL475,([^,]*),(.*)$", fields = { "serial", "firmware" } },
  setup = { "UNIT 2", "RDGMODE 1,3,1,1,1", "AUTO 1" },
  measure = function(io) return { field(io) } end,
  emulator = {
    answers = {
      ["*IDN?"] = "LSCI,MODEL475,4750001,1.2",
      ["RDGFIELD?"] = function(e) return string.format("%+.6E", e.field and e.field[1] or 0) end,
    },
  },
}
