-- Metrolab THM1176 three-axis Hall magnetometer, on USB (USBTMC).
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Metrolab THM1176 user's manual 1.3, chapter 5 (MEAS? resets the settings, so INIT and FETCH; numbers come with
-- their unit; bit 2 of the status byte: there are errors); Hyperfine/pyTHM1176.
local set = settings {
  range = { default = 0.3, unit = "T", min = 0.1, max = 3, help = "0.1, 0.3, 1 or 3 of a THM1176-MF" },
  average = { default = 100, min = 1, max = 10000, help = "of so many measurements" },
}
local FETCH = ":FETC:X? 5;:FETC:Y? 5;:FETC:Z? 5;*STB?"

local function check(io, status)
  if status & 4 == 0 then return end
  local problem = io:ask(":SYST:ERR?")
  for _ = 1, 20 do -- the rest of them
    if io:ask(":SYST:ERR?"):find("^%+?0") then break end
  end
  io:fail("refused", "it reports " .. problem)
end

return {
  title = "Metrolab THM1176",
  kind = "field_probe",
  axis_count = 3,
  range = set.range,
  unit = "T",
  link = { buses = { "usbtmc" }, terminator = "\n" },
  identity = { ask = "*IDN?", match = "^Metrolab[^,]*,(THM1176[^,]*),([^,]*),(.*)$", fields = { "name", "serial", "firmware" } },
  setup = { "*CLS", (":SENS:AUTO OFF;:SENS %g T"):format(set.range), (":AVER:COUN %d"):format(set.average), ":UNIT T" },
  start_up = function(io) check(io, tonumber(io:ask("*STB?"))) end,
  measure = function(io)
    io:send(":INIT")
    io:ask("*OPC?") -- until it has measured: whether FETCH waits the manual does not say
    local x, y, z, status = io:ask(FETCH):match("^([^;]*);([^;]*);([^;]*);%s*(%d+)")
    check(io, tonumber(status) or 4)
    local field = {}
    for axis, said in ipairs { x, y, z } do
      local value, unit = said:match("^%s*([-+%d.eE]+)%s*(%a*)")
      if unit ~= "T" then io:fail("protocol", "no field in tesla: " .. said) end
      field[axis] = tonumber(value)
    end
    return field
  end,
  emulator = {
    message = function(e, m)
      if m == "*IDN?" then return "Metrolab Technology SA,THM1176-MF,1176001,el-D.1.3" end
      if m == "*STB?" then return "0" end
      if m == "*OPC?" then return "1" end
      if m == FETCH then
        local f = e.field or { 0, 0, 0 }
        return ("%.5f T;%.5f T;%.5f T;0"):format(f[1], f[2], f[3])
      end
    end,
  },
}
