-- The simulated laboratory with a gel in the eye: porcine vitreous an hour out of its cavity (2.8 Pa, the one modulus that was
-- measured; "porcine_vitreous" is that of the living eye, five times stiffer), and the magnet that pulls through it.
-- docs/simulated_laboratory.md lists the gel's assumed and fitted parameters. The loop's model has oil, as it was tuned.
local units = require "units"
local mm, um, ms, Hz, cSt = units.mm, units.um, units.ms, units.Hz, units.cSt

return {
  title = "Simulated OctoMag with porcine vitreous in the eye",
  model = {
    robot = "ndfeb_cylinder_1mm",
    medium = { name = "silicone oil", density = 970, kinematic_viscosity = 500 * cSt },
  },
  coils = { driver = "usb3103", address = "emulated", amperes_per_volt = 2, current_limit = 12 * units.A },
  pose_sensor = { driver = "simulated", frame_rate = 15 * Hz, latency = 80 * ms, noise = 0.3 * 14.3 * um },
  sample = { driver = "simulated", placement_scatter = 0.3 * mm },
  truth = { coil_delay = 40 * ms, gel = { name = "porcine_vitreous_removed" } }, -- delay: see simulated.lua
}
