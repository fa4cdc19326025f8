-- Lake Shore 475 DSP gaussmeter, one axis, on RS-232.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Lake Shore 475 user's manual, chapter 6 (7 bits, odd parity, 50 ms between messages; a wrong command
-- is passed over in silence, so what was set is read back); InstrumentKit lakeshore475.py.
local set = settings {
  probe_range = { default = 3.5, unit = "T", min = 0.01, max = 35, help = "largest field of the probe" },
}

return {
  title = "Lake Shore 475 gaussmeter",
  kind = "field_probe",
  axis_count = 1,
  range = set.probe_range,
  unit = "T",
  link = { baud_rate = 9600, data_bits = 7, parity = "odd", terminator = "\r\n", pause = 0.1 },
  identity = { ask = "*IDN?", match = "^LSCI,MODEL475,([^,]*),(.*)$", fields = { "serial", "firmware" } },
  setup = { "UNIT 2", "RDGMODE 1,3,1,1,1", "AUTO 1" }, -- tesla; DC with five digits; the range by itself
  start_up = function(io)
    if tonumber(io:ask("UNIT?")) ~= 2 then io:fail("refused", "it does not measure in tesla") end
  end,
  measure = function(io)
    local answer = io:ask("RDGFIELD?")
    return { tonumber(answer) or io:fail("refused", "no field: " .. answer) } -- "OL", or no probe
  end,
  emulator = {
    answers = {
      ["*IDN?"] = "LSCI,MODEL475,4750001,1.2",
      ["UNIT?"] = function(e) return e.unit or "1" end,
      ["RDGFIELD?"] = function(e)
        local tesla = e.field and e.field[1] or 0
        return string.format("%+.6E", e.unit == "2" and tesla or tesla * 1e4)
      end,
      { "^UNIT ([1-4])$", function(e, unit) e.unit = unit end },
    },
  },
}
