-- An Arduino with StandardFirmata: one pin as a switch, as the contact of an interlock, or both as an instrument.
-- SPDX-License-Identifier: Apache-2.0
-- Sources: Firmata protocol 2.6 and StandardFirmata.ino: F4 pin mode, 90+port (two times 7 bits) a digital port,
-- D0+port 1 reports a port, which is also told at once; F0 79 F7 asks for the firmware's name.
local set = settings {
  plays = { default = "switch", choices = { "switch", "interlock_input", "instrument" }, help = "its role" },
  output = { default = 13, min = 2, max = 19, help = "pin of the switch" },
  input = { default = 2, min = 2, max = 19, help = "pin of the contact, which joins it to ground when closed" },
}
local reads, writes = set.plays ~= "switch", set.plays ~= "interlock_input"
local INPUT_PULLUP, OUTPUT = "\x0B", "\x01"
local written = 0 -- of the output's port

local function rest(head) return head:find("[\xC0-\xDF]") and 1 or head:find("[\x80-\xEF\xF4\xF9]") and 2 or 0 end
local function port(pin, command) return string.char(command + pin // 8) end
local function write(io, on)
  local bit = 1 << set.output % 8
  written = on and written | bit or written & ~bit
  io:send(port(set.output, 0x90) .. string.char(written & 0x7F, written >> 7))
end
local function closed(io)
  local head = port(set.input, 0x90)
  local told = io:ask(port(set.input, 0xD0) .. "\1", { match = function(m) return m:sub(1, 1) == head end })
  return (told:byte(2) | told:byte(3) << 7) >> set.input % 8 & 1 == 0 -- pulled to ground
end

return {
  title = "Arduino with Firmata",
  kind = set.plays,
  link = {
    baud_rate = 57600,
    opening_pause = 2.5, -- it restarts when it is opened
    message = { header = 1, rest = rest },
  },
  identity = function(io) -- F0 79 version, name in pairs of 7 bits, F7: byte by byte, for its length is not told
    io:ask("\xF0\x79\xF7", { match = "^\x79" })
    local bytes = {}
    repeat
      bytes[#bytes + 1] = io:read()
    until bytes[#bytes] == "\xF7" or #bytes > 200
    local name = {}
    for i = 3, #bytes - 2, 2 do
      name[#name + 1] = string.char(bytes[i]:byte() | bytes[i + 1]:byte() << 7)
    end
    return "Firmata " .. table.concat(name), "", ("%d.%d"):format(bytes[1]:byte(), bytes[2]:byte())
  end,
  start_up = function(io)
    if reads then io:send("\xF4" .. string.char(set.input) .. INPUT_PULLUP) end
    if writes then io:send("\xF4" .. string.char(set.output) .. OUTPUT) end
    if writes then write(io, false) end
  end,
  make_safe = function(io)
    if writes then write(io, false) end
  end,
  properties = {
    on = writes and { type = "flag", set = write, help = "its output" } or nil,
    closed = reads and { type = "flag", ask = closed, every = 0.1, help = "its contact" } or nil,
  },
  emulator = {
    message = function(e, m)
      if m == "\x79" then return { "\xF0", "\x79", "\2", "\6", "S", "\0", "t", "\0", "d", "\0", "\xF7" } end
      if m:find("^[\xD0-\xDF]") then return string.char(m:byte() - 0x40, 0, 0) end
    end,
  },
}
