-- A laboratory: an OctoMag behind a USB-3103, the BIOM on a Pololu Tic, a GigE Vision camera on the microscope, a
-- SpaceMouse in the operator's hand and a pedal under the foot. Copy it, and put in what `vitreo devices` prints.
--
-- Without the hardware it opens unchanged among emulated instruments:
--   vitreo emulate scripts/rigs/octomag_lab.lua -- vitreo devices --rig scripts/rigs/octomag_lab.lua
local units = require "units"
local mm, um, ms, s, A, Hz = units.mm, units.um, units.ms, units.s, units.A, units.Hz

return {
  title = "OctoMag laboratory",

  model = {
    eye = "model_eye_5_3",
    robot = "coni_2mm",
    field = "octomag",
  },

  -- address: the camera's identity as `vitreo devices` shows it, or its IP address. Give the network interface of the
  -- camera jumbo frames and set packet_size = 8000; on a shared network leave 1400.
  top_camera = {
    driver = "genicam",
    address = "genicam:127.0.0.1",
    width_px = 640,
    height_px = 480,
    frame_rate = 60 * Hz,
    exposure = 5 * ms,
    effective_pixel = 15 * um, -- of the aerial image, measured with a ruled slide in its place
  },

  -- hid:VENDOR:PRODUCT, with :SERIAL where there are two of them. The device has no watchdog and holds its voltages when
  -- the host dies: wire digital line 0 to the amplifiers' enable input, with the emergency stop in series.
  coils = {
    driver = "usb3103",
    address = "hid:09db:009c",
    amperes_per_volt = 2,
    current_limit = 12 * A,
    interlock_total_current = 60 * A,
    enable_line = 0,
  },

  -- A 200-step motor on a spindle of 1 mm: 5 um a full step. The controller's own timeout stops it when the host falls
  -- silent. It must be homed after it was without power: rig.lens_mover:home().
  lens_mover = {
    driver = "pololu_tic",
    address = "usb:1ffb:00b3",
    step_length = 5 * um,
    usteps_per_step = 8,
    travel = 10 * mm,
    speed = 5 * mm / s,
    current_limit = 0.48 * A,
    home = "reverse",
    command_timeout = 1 * s,
  },

  joystick = { driver = "spacemouse", address = "hid:256f:c635" },
  pedal = { driver = "foot_pedal", address = "hid:05f3:0268", layout = "xkeys_xk3" },
}
