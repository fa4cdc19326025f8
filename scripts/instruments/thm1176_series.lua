-- Metrolab THM1176 three-axis Hall magnetometer, on USB (USBTMC), as a sensor that takes series: up to 2048 fields at
-- equal distances of its own clock, which are read when all are in. As the role field_probe it is thm1176.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Metrolab THM1176 user's manual 1.3, 6-6 and 6-7 (the timer's period 122 us to 2.79 s, count to 2048; a series is
-- fetched as a list, each number with its unit); Hyperfine/pyTHM1176.
local set = settings {
  range = { default = 0.3, unit = "T", min = 0.1, max = 3, help = "0.1, 0.3, 1 or 3 of a THM1176-MF" },
}
local COUNT, ends = 1, 0

local function check(io)
  if tonumber(io:ask("*STB?")) & 4 == 0 then return end
  local problem = io:ask(":SYST:ERR?")
  for _ = 1, 20 do -- the rest of them
    if io:ask(":SYST:ERR?"):find("^%+?0") then break end
  end
  io:fail("refused", "it reports " .. problem)
end
local function begin(io, count, period)
  count = count // 1
  io:send((":ABOR;:AVER:COUN 1;:TRIG:SOUR TIM;:TRIG:TIM %gS;:TRIG:COUN %d"):format(period, count))
  io:send(":INIT")
  COUNT, ends = count, io:now() + count * period
  check(io)
end
local function fetch(axis)
  return function(io)
    local field = {}
    for number, unit in io:ask((":FETC:ARR:%s? %d,5"):format(axis, COUNT)):gmatch("([-+%d.eE]+)%s*(%a*)") do
      if unit ~= "T" then io:fail("protocol", "no field in tesla: " .. number .. " " .. unit) end
      field[#field + 1] = tonumber(number)
    end
    check(io)
    if #field ~= COUNT then io:fail("protocol", ("%d fields of %d"):format(#field, COUNT)) end
    return field
  end
end
local function one(io) -- a single one, now
  begin(io, 1, 0.001)
  io:ask("*OPC?")
  local x, y, z = fetch("X")(io)[1], fetch("Y")(io)[1], fetch("Z")(io)[1]
  return (x * x + y * y + z * z) ^ 0.5
end

return {
  title = "Metrolab THM1176, series",
  kind = "sensor",
  measures = "field",
  link = { buses = { "usbtmc" }, terminator = "\n", timeout = 3, longest = 65536 },
  identity = { ask = "*IDN?", match = "^Metrolab[^,]*,(THM1176[^,]*),([^,]*),(.*)$", fields = { "name", "serial", "firmware" } },
  setup = { "*CLS", (":SENS:AUTO OFF;:SENS %g T"):format(set.range), ":UNIT T" },
  properties = {
    value = { unit = "T", ask = one, help = "the field's magnitude, now" },
    x = { unit = "T", type = "numbers", ask = fetch("X"), help = "of the last series" },
    y = { unit = "T", type = "numbers", ask = fetch("Y"), help = "of the last series" },
    z = { unit = "T", type = "numbers", ask = fetch("Z"), help = "of the last series" },
  },
  commands = {
    take = {
      send = begin,
      arguments = {
        { name = "count", min = 1, max = 2048, help = "fields in the series" },
        { name = "period", unit = "s", min = 122e-6, max = 2.79, help = "from one to the next" },
      },
      done = function(io) return io:now() >= ends and io:ask("*OPC?") == "1" end,
      lasts = 6000,
      help = "takes a series; x, y and z are it then",
    },
  },
  emulator = {
    message = function(e, m)
      if m == "*IDN?" then return "Metrolab Technology SA,THM1176-MF,1176001,el-D.1.3" end
      if m == "*STB?" then return "0" end
      if m == "*OPC?" then return "1" end
      local axis, count = m:match("^:FETC:ARR:(%u)%? (%d+)")
      if axis then return (("%.5f T,"):format(axis == "Z" and 0.0123 or 0)):rep(count):sub(1, -2) end
    end,
  },
}
