-- Harvard Apparatus Pump 11 (also 22), one syringe, at address 0.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Harvard Pump 11 user's manual (answers: line feed, what was asked for, carriage return, line feed, the address
-- and a sign: `:` stopped, `>` infuses, `<` withdraws, `*` stalled); pumpy.py. It has no command that asks for its model.
local set = settings {
  diameter = { default = 14.43, unit = "mm", min = 0.1, max = 35, help = "inner diameter of the syringe" },
  largest_rate = { default = 10, unit = "mL/min", min = 0.001, max = 70, help = "to which its rate may be set" },
}

-- Its sign, and what it says.
local function tell(io, command)
  local said, sign = io:ask("00" .. command):match("^%s*(.-)%s*00([:<>*/])%s*$")
  if sign == "*" then io:fail("refused", "it has stalled") end
  if said ~= "" and not said:find("^[%d.]+$") then io:fail("refused", command .. ": it answers " .. (said or "garbage")) end
  return sign, said
end
local function number(value) return ("%.4f"):format(value):sub(1, 5):gsub("%.$", "") end
local function stop(io) tell(io, "STP") end
local function runs(io) return tell(io, "RAT") ~= ":" end
local function run(sign)
  return function(io)
    tell(io, "RUN")
    if tell(io, "RAT") ~= sign then tell(io, "REV") end
    if tell(io, "RAT") ~= sign then io:fail("refused", "it does not run that way") end
  end
end

return {
  title = "Harvard Pump 11 syringe pump",
  kind = "pump",
  link = { baud_rate = 9600, stop_bits = 2, send_terminator = "\r", message = { quiet = 0.05 } },
  identity = { ask = "00DIA", match = "^%s*[%d.]+%s+00[:<>*]%s*$" },
  start_up = function(io)
    stop(io)
    tell(io, "MMD" .. number(set.diameter))
  end,
  make_safe = stop,
  properties = {
    rate = {
      unit = "mL/min",
      min = 0,
      max = set.largest_rate,
      help = "of its flow; 0 stops it",
      ask = function(io) return (select(2, tell(io, "RAT"))) end,
      set = function(io, value) tell(io, value > 0 and "MLM" .. number(value) or "STP") end,
    },
    delivered = { unit = "mL", help = "since it was cleared", ask = function(io) return (select(2, tell(io, "VOL"))) end },
    running = { type = "flag", ask = runs },
  },
  commands = {
    infuse = { send = run(">"), help = "run at its rate" },
    withdraw = { send = run("<"), help = "run at its rate, backwards" },
    stop = { send = stop },
    clear_delivered = { send = function(io) tell(io, "CLV") end },
  },
  emulator = {
    start = function(e)
      e.RAT, e.DIA, e.sign, e.way = "1.000", "26.59", ":", ">"
    end,
    message = function(e, m)
      local key, value = m:match("^00(%u+)(.*)$")
      local names = { MMD = "DIA", MLM = "RAT" }
      if names[key] then e[names[key]] = value end
      if key == "RUN" then e.sign = e.way end
      if key == "STP" then e.sign = ":" end
      if key == "REV" then e.way = e.way == ">" and "<" or ">" end
      if key == "REV" and e.sign ~= ":" then e.sign = e.way end
      local said = key == "VOL" and "0.000" or value == "" and e[key]
      return "\n" .. (type(said) == "string" and said .. "\r\n" or "") .. "00" .. e.sign
    end,
  },
}
