-- New Era NE-1000 syringe pump (also sold as WPI Aladdin), at address 0, in its basic mode.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: New Era NE-1000 user's manual, chapter 10 (answers: STX, address, state, data, ETX; numbers of four digits
-- and a point); nesp-lib-py. An alarm is told once, instead of an answer: after power-up that of its reset, A?R.
local set = settings {
  diameter = { default = 14.43, unit = "mm", min = 0.1, max = 50, help = "inner diameter of the syringe" },
  largest_rate = { default = 10, unit = "mL/min", min = 0.001, max = 150, help = "to which its rate may be set" },
}
local PROBLEMS = { S = "it has stalled", T = "its host was silent", OOR = "out of range", NA = "not now", COM = "garbled" }
local PER_MINUTE = { UM = 1e-3, MM = 1, UH = 1e-3 / 60, MH = 1 / 60 } -- in mL

-- Its state (I infuses, W withdraws, S stopped, P paused, ...), and what it says.
local function tell(io, command)
  local answer = io:ask(command)
  if answer:find("^%d%dA%?R") then answer = io:ask(command) end
  local state, said = answer:match("^%d%d(%u)(.*)$")
  local problem = not state and answer or said:match("^%?(.*)$")
  if problem then io:fail("refused", ("%s: %s"):format(command, PROBLEMS[problem] or "it answers " .. answer)) end
  return state, said
end
local function number(value) return (value < 10 and "%.3f" or value < 100 and "%.2f" or "%.1f"):format(value) end
local function runs(io) return ("IWTX"):find((tell(io, ""))) ~= nil end
local function stop(io) -- the first one pauses, the second one ends
  if tell(io, "") ~= "S" and tell(io, "STP") ~= "S" then tell(io, "STP") end
end
local function dispense(way)
  local function send(io, volume)
    return stop(io) or tell(io, "DIR" .. way) and tell(io, "VOLML") and tell(io, "VOL" .. number(volume)) and tell(io, "RUN")
  end
  local volume = { name = "volume", unit = "mL", min = 0.001, max = 200 }
  return { send = send, arguments = { volume }, lasts = 7200, done = function(io) return not runs(io) end }
end
local rate = { unit = "mL/min", min = 0, max = set.largest_rate, help = "of its flow; 0 stops it" }
function rate.ask(io)
  local value, unit = select(2, tell(io, "RAT")):match("^([%d.]+)(%u%u)$")
  return value * PER_MINUTE[unit]
end
function rate.set(io, value) return value == 0 and stop(io) or value > 0 and tell(io, "RAT" .. number(value) .. "MM") end

return {
  title = "New Era NE-1000 syringe pump",
  kind = "pump",
  link = { baud_rate = 19200, send_terminator = "\r", message = { start = "\2", stop = "\3" } },
  identity = { ask = "VER", match = "^%d%d%uNE1000V(.+)$", fields = { "firmware" }, tries = 2 },
  start_up = function(io) return stop(io) or tell(io, "DIA" .. number(set.diameter)) end,
  make_safe = stop,
  properties = { rate = rate, running = { type = "flag", ask = runs } },
  commands = { infuse = dispense("INF"), withdraw = dispense("WDR"), stop = { send = stop } },
  emulator = {
    message = function(e, m)
      local key, value = m:match("^(%u*)(.*)$")
      if value ~= "" then e[key] = value end
      if key:find("^DIR.") then e.way = key:sub(4, 4) end
      if key == "RUN" then e:glide("out", e:at("out") + (e.VOL or 1), (e.RAT or "1"):match("[%d.]+") / 60) end
      if key == "STP" then e:glide("out", e:at("out"), 1) end
      local said = key == "VER" and "NE1000V3.928" or m == "RAT" and (e.RAT or "1.000MM") or ""
      return "00" .. (e:gliding("out") and (e.way or "I") or "S") .. said
    end,
  },
}
