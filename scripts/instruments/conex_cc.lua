-- Newport CONEX-CC with its stage of one axis, over USB as a serial port, at address 1.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Newport CONEX-CC controller documentation, chapter 2 (commands do not answer: TE tells whether they were taken;
-- states of TS: 0A to 11 not referenced, 14 configuration, 1E homing, 28 moving, 32 to 35 ready, 3C to 3E disabled);
-- yaqd-newport (READY may still be told just after PA); Micro-Manager NewportCONEX.
local set = settings {
  travel_min = { default = 0, unit = "mm", min = -500, max = 500, help = "of the stage" },
  travel_max = { default = 12, unit = "mm", min = -500, max = 500, help = "of the stage" },
  max_speed = { default = 0.4, unit = "mm/s", min = 0.001, max = 100, help = "of the stage" },
}
local ERRORS = { C = "out of range", D = "not allowed", G = "beyond its limits", H = "not referenced", J = "disabled" }

local function ask(io, what) return io:ask("1" .. what, { match = "^1" .. what }):sub(4) end
local function tell(io, command)
  io:send("1" .. command)
  local error = ask(io, "TE")
  if error ~= "@" then io:fail("refused", ("%s: %s"):format(command, ERRORS[error] or "error " .. error)) end
end
local function state(io) return tonumber(ask(io, "TS"):sub(5, 6), 16) end
local function enabled(io)
  if state(io) >= 0x3C then tell(io, "MM1") end
end

return {
  title = "Newport CONEX-CC",
  kind = "stage",
  axes = { { unit = "mm", travel = { set.travel_min, set.travel_max }, max_speed = set.max_speed, resolution = 2e-4 } },
  starts_within = 0.1,
  link = { baud_rate = 921600, flow = "xon_xoff", terminator = "\r\n" },
  identity = { ask = "1VE", match = "^1VE%s*(CONEX%-CC)%s*(.*)$", fields = { "_", "firmware" } },
  start_up = function(io) ask(io, "TE") end, -- an old error
  position = function(io) return tonumber(ask(io, "TP")) end,
  set_off = function(io, to, speed)
    enabled(io)
    tell(io, ("VA%.6f"):format(speed))
    tell(io, ("PA%.6f"):format(to[1]))
  end,
  moving = function(io)
    local now = state(io)
    return now == 0x28 or now == 0x1E or now == 0x1F
  end,
  halt = function(io)
    io:send("1ST")
    ask(io, "TE") -- which it is not to tell the next command: it may have stood
  end,
  home = function(io)
    if state(io) > 0x11 then io:fail("refused", "it is homed already, and homes again only after 1RS") end
    tell(io, "OR")
  end,
  homed = function(io) return state(io) >= 0x28 end,
  emulator = {
    start = function(e) e.speed = 0.4 end,
    position = function(e) return e:at("x") end,
    answers = {
      ["1VE"] = "1VE CONEX-CC 2.0.1",
      ["1TE"] = "1TE@",
      ["1TP"] = function(e) return ("1TP%.6f"):format(e:at("x")) end,
      ["1TS"] = function(e) return "1TS0000" .. (not e.homed and "0A" or e:gliding("x") and "28" or "33") end,
      ["1OR"] = function(e) e.homed = true end,
      ["1ST"] = function(e) e:glide("x", e:at("x"), 1) end,
      { "^1VA(.+)$", function(e, speed) e.speed = tonumber(speed) end },
      { "^1PA(.+)$", function(e, to) e:glide("x", tonumber(to), e.speed) end },
    },
  },
}
