-- The laboratory of octomag_lab with eight Kepco BOP supplies on the network in the place of the USB-3103 and its amplifiers: one
-- address a coil, made in a loop.
--
-- Without the hardware it opens unchanged among emulated instruments:
--   vitreo emulate octomag_bop -- vitreo devices --rig octomag_bop
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
local A, V, s, ms = units.A, units.V, units.s, units.ms

-- In a laboratory each supply has an address of its own: ("tcp:10.0.0.%d:5025"):format(10 + coil); on serial ports
-- ("serial:/dev/ttyUSB%d"):format(coil + 2). These are of the emulated ones.
local supplies = {}
for coil = 1, 8 do
  supplies[coil] = ("tcp:127.0.0.1:%d"):format(5210 + coil)
end

return {
  base = "octomag_lab",
  title = "OctoMag laboratory, eight Kepco BOP supplies",

  coils = {
    driver = "kepco_bop",
    address = table.concat(supplies, ", "),
    current_limit = 12 * A,
    voltage_limit = 20 * V,
    max_slope = 200 * A / s,
    reply_timeout = 500 * ms,
    interlock_total_current = 60 * A,
  },
}
