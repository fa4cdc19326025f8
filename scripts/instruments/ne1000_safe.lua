-- New Era NE-1000 syringe pump at address 0 in its safe mode: a checksum in each packet, and a pump that stops by itself
-- when its host is silent. After a run it beeps for that reason; the driver ne1000 is for its basic mode.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: New Era NE-1000 user's manual, 10.2.3 and 10.2.4 (STX, length of all that follows with itself, text, CRC, ETX;
-- each valid packet begins the time-out anew; an alarm is also told unasked); nesp-lib-py (SAF is a packet in either mode).
local set = settings {
  diameter = { default = 14.43, unit = "mm", min = 0.1, max = 50, help = "inner diameter of the syringe" },
  largest_rate = { default = 10, unit = "mL/min", min = 0.001, max = 150, help = "to which its rate may be set" },
  silence = { default = 5, unit = "s", min = 2, max = 255, help = "of its host, after which it stops" },
}
local PROBLEMS = { S = "it has stalled", T = "its host was silent", OOR = "out of range", NA = "not now", COM = "garbled" }
local PER_MINUTE = { UM = 1e-3, MM = 1, UH = 1e-3 / 60, MH = 1 / 60 } -- in mL

-- Its state (I infuses, W withdraws, S stopped, P paused, ...), and what it says.
local function tell(io, command)
  local state, said = io:ask(command):match("^%d%d(%u)(.*)$")
  if not state then io:fail("protocol", command .. ": not understood") end
  local problem = said:match("^%?(.*)$")
  if problem then io:fail("refused", ("%s: %s"):format(command, PROBLEMS[problem] or "it answers " .. said)) end
  return state, said
end
local function identify(io)
  -- An alarm is told instead of an answer, and gone by that: its power was off, or its last host has left.
  if io:ask(("SAF%d"):format(set.silence // 1)):find("^%d%dA%?[RT]") then io:ask("") end
  local version = io:ask("VER"):match("^%d%d%uNE1000V(.+)$")
  if version then return "New Era NE-1000 syringe pump", nil, version end
end
local function number(value) return (value < 10 and "%.3f" or value < 100 and "%.2f" or "%.1f"):format(value) end
local function runs(io) return ("IWTX"):find((tell(io, ""))) ~= nil end
local function stop(io) -- the first one pauses, the second one ends
  if io:ask(""):find("^%d%dA") then return end -- an alarm has stopped it
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
  title = "New Era NE-1000 syringe pump, watched",
  kind = "pump",
  link = { baud_rate = 19200, message = { start = "\2", counted = 4, stop = "\3", checksum = "crc16_xmodem" } },
  identity = identify,
  start_up = function(io) return stop(io) or tell(io, "DIA" .. number(set.diameter)) end,
  make_safe = stop,
  properties = { rate = rate, running = { type = "flag", ask = runs, every = set.silence / 4 } },
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
