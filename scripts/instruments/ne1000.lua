-- New Era NE-1000 syringe pump (also WPI Aladdin), at address 0, in its basic mode.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: New Era NE-1000 user's manual, chapter 10 (answers: STX, address, state, data, ETX; numbers of four
-- digits and a point); nesp-lib-py. Its state after power-up is an alarm, once: the question is asked again.
local set = settings {
  diameter = { default = 14.43, unit = "mm", min = 0.1, max = 50, help = "inner diameter of the syringe" },
  largest_rate = { default = 10, unit = "mL/min", min = 0.001, max = 150, help = "that its rate may be set to" },
}
local ALARMS = { R = "it was reset", S = "it has stalled", T = "its host was silent", E = "its program", O = "out of range" }
local ERRORS = { [""] = "unknown", NA = "not applicable now", OOR = "out of range", COM = "garbled", IGN = "ignored" }
local PER_MINUTE = { UM = 1e-3, MM = 1, UH = 1e-3 / 60, MH = 1 / 60 } -- in mL

-- What it answers: its state (I infusing, W withdrawing, S stopped, P paused, ...), and the data.
local function tell(io, command)
  local state, rest = io:ask(command):match("^%d%d(%u)(.*)$")
  if state == "A" and rest == "?R" then state, rest = io:ask(command):match("^%d%d(%u)(.*)$") end
  if state == "A" then io:fail("refused", "alarm: " .. (ALARMS[rest:sub(2)] or rest)) end
  local problem = (rest or "?"):match("^%?(.*)$")
  if problem then io:fail("refused", command .. ": " .. (ERRORS[problem] or problem)) end
  return state, rest
end
local function number(value) return (("%.4g"):format(value):find("e") and "%.3f" or "%.4g"):format(value) end
local function in_ml(text)
  local value, unit = text:match("([%d.]+)(%u%u)")
  return tonumber(value) * (unit == "UL" and 1e-3 or 1)
end
local function stop(io) -- what runs is paused, what is paused is stopped
  for _ = 1, 2 do
    if tell(io, "") ~= "S" then tell(io, "STP") end
  end
end
local function dispense(way)
  return { lasts = 7200, arguments = { { name = "volume", unit = "mL", min = 1e-3, max = 200 } }, help = way .. " a volume, and wait",
    send = function(io, volume)
      stop(io)
      for _, command in ipairs { "DIR" .. way, "VOLML", "VOL" .. number(volume), "RUN" } do tell(io, command) end
    end,
    done = function(io) return not ("IW"):find((tell(io, ""))) end }
end

return {
  title = "New Era NE-1000 syringe pump",
  kind = "pump",
  link = { baud_rate = 19200, send_terminator = "\r", message = { start = "\2", stop = "\3" } },
  identity = { ask = "VER", match = "^%d%d%uNE1000V(.+)$", fields = { "firmware" }, tries = 2 },
  start_up = function(io)
    stop(io)
    tell(io, "DIA" .. number(set.diameter))
  end,
  make_safe = stop,
  properties = {
    rate = { unit = "mL/min", min = 0, max = set.largest_rate, help = "of its flow; 0 stops it",
      ask = function(io)
        local value, unit = select(2, tell(io, "RAT")):match("([%d.]+)(%u%u)")
        return tonumber(value) * PER_MINUTE[unit]
      end,
      set = function(io, rate) if rate > 0 then tell(io, "RAT" .. number(rate) .. "MM") else stop(io) end end },
    direction = { choices = { infuse = "INF", withdraw = "WDR" },
      ask = function(io) return (select(2, tell(io, "DIR"))) end,
      set = function(io, way) tell(io, "DIR" .. way) end },
    infused = { unit = "mL", help = "since it was last cleared",
      ask = function(io) return in_ml(select(2, tell(io, "DIS")):match("^I([%d.]+)") .. "ML") end },
    running = { type = "flag", ask = function(io) return ("IW"):find((tell(io, ""))) ~= nil end },
  },
  commands = {
    infuse = dispense("INF"), withdraw = dispense("WDR"),
    run = { help = "run at its rate", send = function(io) tell(io, "RUN") end },
    stop = { send = stop },
  },
}
