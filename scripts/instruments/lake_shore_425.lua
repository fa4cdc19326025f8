-- Lake Shore 425 gaussmeter, one axis, on USB (a serial port of the kernel's cp210x).
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Lake Shore 425 user's manual, chapter 5; PyMeasure lakeshore425.py (57600 baud, 7 bits, odd parity).
-- A wrong command is passed over in silence, so what was set is read back.
local set = settings {
  probe_range = { default = 3.5, unit = "T", min = 0.0035, max = 3.5, help = "largest field of the probe" },
}

return {
  title = "Lake Shore 425 gaussmeter",
  kind = "field_probe",
  axis_count = 1,
  range = set.probe_range,
  unit = "T",
  link = { baud_rate = 57600, data_bits = 7, parity = "odd", terminator = "\n", pause = 0.1 },
  identity = { ask = "*IDN?", match = "^LSCI,MODEL425,([^,]*),(.*)$", fields = { "serial", "firmware" } },
  setup = { "UNIT 2", "RDGMODE 1,0,1", "AUTO" }, -- tesla; DC, no filter, wide band; the range by itself
  start_up = function(io)
    if tonumber(io:ask("UNIT?")) ~= 2 then io:fail("refused", "it does not measure in tesla") end
    if not io:ask("RDGMODE?"):match("^%s*1%s*,") then io:fail("refused", "it does not measure a constant field") end
  end,
  measure = function(io)
    local answer = io:ask("RDGFIELD?")
    return { tonumber(answer) or io:fail("refused", "no field: " .. answer) } -- "OL", or no probe
  end,
  emulator = {
    answers = {
      ["*IDN?"] = "LSCI,MODEL425,4250001,1.0",
      ["UNIT?"] = function(e) return e.unit or "1" end,
      ["RDGMODE?"] = function(e) return e.mode or "2,0,1" end,
      ["RDGFIELD?"] = function(e)
        local tesla = e.field and e.field[1] or 0
        return string.format("%+.6E", e.unit == "2" and tesla or tesla * 1e4)
      end,
      { "^UNIT ([1-4])$", function(e, unit) e.unit = unit end },
      { "^RDGMODE (%d,%d,%d)$", function(e, mode) e.mode = mode end },
    },
  },
}
