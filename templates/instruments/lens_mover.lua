-- @NAME@: what it is, in one line; maker, model, firmware.
-- SPDX-License-Identifier: Apache-2.0
-- Source: manual, chapter. Write down where each message comes from: the next reader asks.
-- What a rig file may say beside driver and address; in the file `set.travel` has the value, in this unit.
local set = settings {
  travel = { default = 10, unit = "mm", min = 0.1, max = 1000, help = "of the stage" },
}

local function number(text) return tonumber(text) or error("no number: " .. text, 0) end

return {
  title = "@NAME@",
  kind = "lens_mover",
  axes = { { unit = "mm", travel = { 0, set.travel }, max_speed = 2, resolution = 0.001 } },
  starts_within = 0, -- s; of one that may still say that it stands when a motion was just commanded
  link = { terminator = "\n" }, -- @LINK@
  identity = { ask = "*IDN?", match = "^ACME,%u+,([^,]*),(.*)$", fields = { "serial", "firmware" } }, -- refuses every other
  -- Positions are in the unit of the axes. Each function must return within a moment: it does not wait for a motion.
  position = function(io) return number(io:ask("POS?")) end,
  set_off = function(io, target, speed) io:send(("MOVE %.4f %.4f"):format(target[1], speed)) end,
  moving = function(io) return io:ask("BUSY?") == "1" end,
  halt = function(io) io:send("STOP") end,
  home = function(io) io:send("HOME") end, -- of a stage that finds its reference; else leave these two out
  homed = function(io) return io:ask("HOMED?") == "1" end,
  -- The instrument's end, for rigs with address = "emulated" and for the tests. e is its state; e:glide(name, to, speed)
  -- moves something, e:at(name) is where it is, e:gliding(name) whether it moves.
  emulator = {
    position = function(e) return e:at("x") end,
    answers = {
      ["*IDN?"] = "ACME,STAGE,1,1.0",
      ["POS?"] = function(e) return ("%.4f"):format(e:at("x")) end,
      ["BUSY?"] = function(e) return e:gliding("x") and "1" or "0" end,
      ["STOP"] = function(e) e:glide("x", e:at("x"), 1) end,
      ["HOME"] = function(e)
        e.homed = true
        e:glide("x", 0, 2)
      end,
      ["HOMED?"] = function(e) return e.homed and not e:gliding("x") and "1" or "0" end,
      { "^MOVE (%S+) (%S+)$", function(e, to, speed) e:glide("x", tonumber(to), tonumber(speed)) end },
    },
  },
}
