-- Steps of a session with a cadaver porcine eye (thesis 7.2 to 7.4), each a group of entries of the check-list: what came, how
-- it was opened or prepared, light, scleral clearing with its timer, focus, vitrectomy.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local mm, minute = units.mm, units.min

local steps = {}

--- The solutions that clear the sclera (7.4): how long until they act and until they cease to, s: {from, to}.
steps.clearing = {
  verografin = {
    text = "76 % verografin under the conjunctiva",
    acts = { 1.5 * minute, 2 * minute },
    ceases = { 15 * minute, 25 * minute },
  },
  glucose = {
    text = "40 % aqueous glucose under the conjunctiva",
    acts = { 1.5 * minute, 2 * minute }, -- "similar effects": no times of its own
    ceases = { 15 * minute, 25 * minute },
  },
}

--- Keeps in the record what is known of the eye. Empty texts are not known.
function steps.describe(run, p)
  local known = { species = "pig", pipette = p.pipette, light = ("%s, %s"):format(p.light, p.lamp) }
  for field, value in pairs { eye = p.eye_id, age = p.age, died = p.died, removed = p.removed } do
    if value ~= "" then known[field] = value end
  end
  run:describe_sample(known)
  for _, field in ipairs { "eye_id", "age", "died", "removed" } do
    if p[field] == "" then run:note("not known of the eye: " .. field .. " (a parameter of this protocol)") end
  end
end

--- The eye as it comes, and opened (7.2.1) or prepared (7.4).
function steps.prepare(list, p)
  list:must(
    "enucleated before the scalding, within the last two hours, never frozen, carried in tap water at low room temperature",
    { name = "eye_fresh" }
  )
  list:photograph("the eye as it came", { name = "photo_eye" })
  list:item("cornea and lens clear: structure behind the pupil can be seen", { name = "eye_clear" })
  if p.optics == "removed" then
    list:must(
      "cornea dissected at its rim above the pars plana; lens and iris taken out; the vitreous is whole",
      { name = "opened" }
    )
  else
    list:must("epithelium of the cornea taken off with the 22.5° stab knife", { name = "epithelium" })
    list:must("infusion of tap water in place (I86-3W tip, 1 mm incision at the pars plana)", { name = "infusion" })
    local pressure = list:ask("intraocular pressure, mmHg (0: not measured)", { name = "pressure", min = 0, max = 100 })
    if pressure > 0 then list.run:result("intraocular_pressure", pressure) end
  end
  list:must("eye fixed in the holder, under the microscope, in the middle of the coils; tools at hand", { name = "fixed" })
  list:photograph("the eye in its holder", { name = "photo_holder" })
end

--- Light into the eye; through the sclera after it was cleared, where it is.
function steps.light(list, p)
  if p.light == "endoilluminator" then
    list:must(
      "1 mm incision at the pars plana, 20 G endoilluminator in; its magnetic tip where the parameter tip says",
      { name = "light" }
    )
    return
  end
  if p.clearing ~= "none" then steps.clear_sclera(list, p) end
  list:must("LED fibre below the eye, light through the sclera; no bright rim on the image", { name = "light" })
end

--- Clears the sclera and starts its timer.
function steps.clear_sclera(list, p)
  local solution = steps.clearing[p.clearing]
  list:must(solution.text .. ": given", { name = "clearing" })
  list:start_timer("the sclera stays clear", solution.ceases)
  list.run:wait(solution.acts[2])
  list:item("the sclera is clear", { name = "cleared" })
end

--- Before each trial: where the clearing may have ceased, it is done again.
function steps.keep_clear(list, p)
  if p.light == "transscleral" and p.clearing ~= "none" and list:timer_over "the sclera stays clear" then
    list.run:note "the sclera turns opaque again: it is cleared anew"
    steps.clear_sclera(list, p)
  end
end

-- The condensing lens where the retina is sharpest.
local function focus_lens(rig, run)
  if not rig.lens_mover:info().homed then rig.lens_mover:home() end
  local best, best_value = rig.lens_mover:position(), -math.huge
  for _, at in ipairs { -1 * mm, -0.5 * mm, 0, 0.5 * mm, 1 * mm } do
    rig.lens_mover:move_to(at)
    local value = rig.top_camera:grab({ fresh = true }).image:focus().value
    if value > best_value then
      best, best_value = at, value
    end
  end
  rig.lens_mover:move_to(best)
  run:note("condensing lens left at " .. format_quantity(best, "m") .. ", where the retina is sharpest")
end

--- The thesis' order, "easy but not intuitive"; or a vitrectomy lens on the cornea.
function steps.focus(list, rig, run, p)
  if p.optics ~= "removed" then
    list:must("BIOM swung out: microscope focused on the iris, lit from outside", { name = "focus_iris" })
    list:photograph("the iris in focus", { name = "photo_iris" })
  end
  if p.lens == "vitrectomy_lens" then
    list:must("S5.7030u vitrectomy lens on the cornea, gel below it; microscope focused on the retina", { name = "contact_lens" })
  else
    list:must("BIOM swung in", { name = "biom_in" })
    if rig.lens_mover then
      focus_lens(rig, run)
    else
      list:must("condensing lens moved until the retina is sharp", { name = "focus_retina" })
    end
    list:item("working distance changed until the field of view is as wanted: the focus stays", { name = "field_of_view" })
  end
  list:photograph("the retina", { name = "photo_retina" })
end

--- Whether a robot wants the vitreous out: a soft one does (7.1, 7.5), a permanent magnet does not.
function steps.wants_vitrectomy(rig, p)
  if p.vitrectomy ~= "auto" then return p.vitrectomy == "yes" end
  return not rig:model().robot_name:find "NdFeB"
end

--- The decision, and the vitrectomy where it falls for one: a dye marks the dead vitreous.
function steps.vitrectomy(list, rig, run, p)
  if not steps.wants_vitrectomy(rig, p) then
    run:note(("%s: no vitrectomy, the robot is to move in the vitreous"):format(rig:model().robot_name))
    return false
  end
  if p.alive and p.dye == "trypan_blue" then
    error("dye: trypan blue is toxic and is not for a living eye; dye=cortisone is", 0)
  end
  local dyes = { trypan_blue = "0.05 % Trypan blue", cortisone = "crystalline cortisone suspension" }
  list:must("1 mm incision at the pars plana with the sideport knife, Klöti vitrectome in", { name = "vitrectome_in" })
  list:must(dyes[p.dye] .. ": the vitreous that is left shows", { name = "dyed" })
  list:must("vitreous taken out, nothing dyed is left; cavity filled with the substitute", { name = "vitrectomy" })
  list:photograph("after the vitrectomy", { name = "photo_vitrectomy" })
  return true
end

return steps
