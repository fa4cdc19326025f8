-- Thorlabs KDC101 with a stage of one axis (Z8: MTS25, Z825), over USB as a serial port.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Thorlabs APT communications protocol (6 bytes of header, data behind it where the destination has bit 7;
-- velocity is counts/s * 65536 T, acceleration counts/s^2 * 65536 T^2, T = 2048/6e6 s); pyLabLib; thorlabs_apt_protocol.
local set = settings {
  travel = { default = 25, unit = "mm", min = 0.1, max = 300, help = "of the stage, from its home" },
  max_speed = { default = 2.4, unit = "mm/s", min = 0.01, max = 50, help = "of the stage" },
  counts_per_mm = { default = 34304, min = 1, max = 1e7, help = "of its encoder; 34304: Z8" },
}
local SPEED = set.counts_per_mm * 65536 * 2048 / 6e6 -- of 1 mm/s
local ACCELERATION = math.tointeger(SPEED * 2048 / 6e6 * 2 // 1) -- 2 mm/s^2
local BUSY, HOMED = 0x2F0, 0x400 -- of the status: moves, jogs, homes

local function counts(mm) return math.floor(mm * set.counts_per_mm + 0.5) end
local function rest(head) return head:byte(5) >= 128 and string.unpack("<I2", head, 3) or 0 end
local function short(id, p1, p2) return string.pack("<I2BBBB", id, p1 or 1, p2 or 0, 0x50, 0x01) end
local function long(id, format, ...)
  local data = string.pack(format, ...)
  return string.pack("<I2I2BB", id, #data, 0xD0, 0x01) .. data
end
local function ask(io, question, id)
  return io:ask(question, { match = function(answer) return string.unpack("<I2", answer) == id end })
end
local function status(io) return (string.unpack("<I4", ask(io, short(0x0429), 0x042A), -4)) end

return {
  title = "Thorlabs KDC101",
  kind = "stage",
  axes = { { unit = "mm", travel = { 0, set.travel }, max_speed = set.max_speed, resolution = 5e-4 } },
  starts_within = 0.25,
  link = { baud_rate = 115200, flow = "rts_cts", opening_lines = "rts_pulse", message = { header = 6, rest = rest } },
  identity = function(io)
    local serial, model, _, a, b, c = string.unpack("<I4c8I2BBB", ask(io, short(0x0005, 0), 0x0006), 7)
    return model:match("^KDC101") and "Thorlabs KDC101", tostring(serial), ("%d.%d.%d"):format(c, b, a)
  end,
  setup = { short(0x0012, 0), short(0x0210, 1, 1) }, -- no updates unasked; on
  position = function(io) return string.unpack("<i4", ask(io, short(0x0411), 0x0412), 9) / set.counts_per_mm end,
  set_off = function(io, to, speed)
    io:send(long(0x0413, "<I2i4i4i4", 1, 0, ACCELERATION, math.floor(speed * SPEED + 0.5)))
    io:send(long(0x0453, "<I2i4", 1, counts(to[1])))
  end,
  moving = function(io) return status(io) & BUSY ~= 0 end,
  halt = function(io) io:send(short(0x0465, 1, 2)) end, -- as steeply as it accelerates
  home = function(io) io:send(short(0x0443)) end,
  homed = function(io) return status(io) & HOMED ~= 0 end,
  emulator = {
    position = function(e) return e:at("x") end,
    message = function(e, m)
      local id, speed, to = string.unpack("<I2", m), m:sub(17, 20), m:sub(9, 12)
      if id == 0x0005 then return long(0x0006, "<I4c8I2BBBBc66", 27000001, "KDC101", 16, 1, 2, 3, 0, "") end
      if id == 0x0411 then return long(0x0412, "<I2i4", 1, counts(e:at("x"))) end
      if id == 0x0413 then e.speed = string.unpack("<i4", speed) / SPEED end
      if id == 0x0453 then e:glide("x", string.unpack("<i4", to) / set.counts_per_mm, e.speed) end
      if id == 0x0443 then e.homed = e:glide("x", 0, 2) == nil end
      if id == 0x0465 then e:glide("x", e:at("x"), 1) end
      if id == 0x0429 then return long(0x042A, "<I2I4", 1, (e:gliding("x") and 0x10 or 0) | (e.homed and HOMED or 0)) end
    end,
  },
}
