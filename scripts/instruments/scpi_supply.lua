-- A power supply of one output that speaks SCPI, on TCP (port 5025), USB or a serial port: a voltage with a limited current.
-- SPDX-License-Identifier: Apache-2.0
-- Source: SCPI 1999, volume 2: SOURce, OUTPut, MEASure and SYSTem:ERRor. Most bench supplies take these words.
local set = settings {
  highest = { default = 30, unit = "V", min = 0.1, max = 1000, help = "voltage to which it may be set" },
  current_limit = { default = 1, unit = "A", min = 0.001, max = 100, help = "that it gives at most" },
}

return {
  title = "SCPI power supply",
  kind = "actuator",
  measures = "voltage",
  link = { buses = { "tcp", "serial", "udp", "usbtmc", "vxi11", "hislip" }, terminator = "\n" },
  identity = "*IDN?",
  setup = { "OUTP OFF", "VOLT 0", ("CURR %g"):format(set.current_limit) },
  errors = { ask = "SYST:ERR?", none = "^[^%d]*0," },
  make_safe = { "OUTP OFF", "VOLT 0" },
  rescue = { identify = { "*IDN?", "" }, send = { "OUTP OFF", "VOLT 0" }, check = { "OUTP?", "0" } },
  properties = {
    set_point = { unit = "V", ask = "VOLT?", set = "VOLT %.6g", min = 0, max = set.highest },
    on = {
      type = "flag",
      ask = "OUTP?",
      answer = "(%w+)%s*$",
      set = function(io, on) io:send(on and "OUTP ON" or "OUTP OFF") end,
    },
    voltage = { unit = "V", ask = "MEAS:VOLT?", every = 1, help = "at its output" },
    current = { unit = "A", ask = "MEAS:CURR?", every = 1, help = "that flows" },
  },
  emulator = {
    start = function(e)
      e.volts, e.on = 0, "0"
    end,
    answers = {
      ["*IDN?"] = "ACME,SUPPLY,1,1.0",
      ["SYST:ERR?"] = '+0,"No error"',
      ["VOLT?"] = function(e) return ("%.4f"):format(e.volts) end,
      ["OUTP?"] = function(e) return e.on end,
      ["OUTP ON"] = function(e) e.on = "1" end,
      ["OUTP OFF"] = function(e) e.on = "0" end,
      ["MEAS:VOLT?"] = function(e) return ("%.4f"):format(e.on == "1" and e.volts or 0) end,
      ["MEAS:CURR?"] = function(e) return ("%.4f"):format(e.on == "1" and e.volts / 100 or 0) end,
      { "^VOLT (.+)$", function(e, volts) e.volts = tonumber(volts) end },
    },
  },
}
