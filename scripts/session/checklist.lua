-- Check-lists and times for sessions with operators: steps in order, each confirmed and recorded, with photographs where they
-- are requested, and a window of time that runs out.
-- SPDX-License-Identifier: Apache-2.0
local vision = require "vision"
local checklist = {}
checklist.__index = checklist

--- An empty list. options.window = { least, most } in s: how long there is, nothing for no end; options.gone: how much of it
--- had passed before, s.
function checklist.new(run, rig, options)
  options = options or {}
  local list = { run = run, rig = rig, began = run:now(), window = options.window, gone = options.gone or 0 }
  list.rows, list.timers, list.missed = {}, {}, 0
  return setmetatable(list, checklist)
end

local function clock(seconds)
  local sign = seconds < 0 and "-" or ""
  seconds = math.abs(seconds)
  return ("%s%d:%02d h"):format(sign, seconds // 3600, seconds % 3600 // 60)
end

--- What is left of the window, s: {least, most}, until its least and until its most.
function checklist:left()
  if not self.window then return { least = math.huge, most = math.huge } end
  local gone = self.gone + self.run:now() - self.began
  return { least = self.window[1] - gone, most = self.window[2] - gone }
end

--- Notes what is left, as "1:20 h left, 2:20 h at most", and warns when it is over.
function checklist:tell_time()
  if not self.window then return end
  local left = self:left()
  local least, most = left.least, left.most
  local text = ("%s left, %s at most"):format(clock(least), clock(most))
  if most < 0 then
    text = ("the window is over by %s: what is seen from now on is no measurement"):format(clock(-most))
  elseif least < 0 then
    text = ("the window's safe part is over; %s at most"):format(clock(most))
  end
  self.run:note(text)
  return most > 0
end

--- Starts a timer, or starts it anew: what lasts `span` = { least, most }, s.
function checklist:start_timer(name, span)
  self.timers[name] = { began = self.run:now(), least = span[1], most = span[2] }
  self.run:note(("%s for %s to %s from now on"):format(name, clock(span[1]), clock(span[2])))
  self.rows[#self.rows + 1] = { clock(self.run:now() - self.began), "timer: " .. name, "started" }
end

--- Whether a timer's least has passed; one that was never started is not over.
function checklist:timer_over(name)
  local timer = self.timers[name]
  return timer ~= nil and self.run:now() - timer.began >= timer.least
end

--- Asks for a number for the record; 0 is the default.
function checklist:ask(text, options)
  local value = self.run:ask(text, { min = options.min, max = options.max, default = 0, name = options.name })
  self.rows[#self.rows + 1] = { clock(self.run:now() - self.began), text, ("%g"):format(value) }
  return value
end

--- Asks whether one thing is done; "no" is kept, and an error when it is `needed`.
function checklist:item(text, options)
  options = options or {}
  local done = self.run:confirm(text, { name = options.name })
  self.rows[#self.rows + 1] = { clock(self.run:now() - self.began), text, done and "done" or "not done" }
  if not done then
    self.missed = self.missed + 1
    if options.needed then error("not done: " .. text, 0) end
  end
  return done
end

--- Waits until it is done: asks again, up to `times`, else an error.
function checklist:must(text, options)
  for _ = 1, (options or {}).times or 3 do
    if self:item(text, options) then return end
  end
  error("not done: " .. text, 0)
end

--- A photograph for the record: a file that the operator names, or, with "camera", what the top camera sees.
function checklist:photograph(caption, options)
  local path = self.run:ask(
    "photograph: " .. caption .. " (a file, or camera, or none)",
    { type = "text", default = "camera", name = options and options.name }
  )
  if path == "none" then
    self.rows[#self.rows + 1] = { clock(self.run:now() - self.began), "photograph: " .. caption, "none" }
    return nil
  end
  local image = path == "camera" and self.rig.top_camera:grab().image or vision.image { file = path }
  self.run:picture { title = caption, image = image, note = path == "camera" and "by the top camera" or path }
  local name = ("photograph_%02d.png"):format(#self.rows + 1)
  image:save(name)
  self.rows[#self.rows + 1] = { clock(self.run:now() - self.began), "photograph: " .. caption, name }
  return image
end

--- Asks the operator for a note; an empty one is none.
function checklist:note(about, options)
  local text = self.run:ask("notes on " .. about, { type = "text", default = "", name = options and options.name })
  if text ~= "" then
    self.run:note(about .. ": " .. text)
    self.rows[#self.rows + 1] = { clock(self.run:now() - self.began), "note: " .. about, text }
  end
  return text
end

--- Puts the list as it was gone through into the report.
function checklist:report(title)
  self.run:table { title = title, header = { "after", "what", "how" }, rows = self.rows }
  self.run:result("checklist_not_done", self.missed)
end

return checklist
