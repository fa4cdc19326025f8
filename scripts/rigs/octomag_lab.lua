-- A laboratory: an OctoMag behind a USB-3103, the BIOM on a Pololu Tic, a GigE Vision camera on the microscope, an MP-285
-- under the camera, a Zaber turntable, a teslameter, a ring of LEDs, a SpaceMouse in the operator's hand and a pedal under
-- the foot. Copy it, and put in what `vitreo devices` prints. docs/instruments.md tells the wiring and all settings.
--
-- Without the hardware it opens unchanged among emulated instruments:
--   vitreo emulate scripts/rigs/octomag_lab.lua -- vitreo devices --rig scripts/rigs/octomag_lab.lua
local units = require "units"
local mm, um, ms, s, A, Hz = units.mm, units.um, units.ms, units.s, units.A, units.Hz
local mT, deg = units.mT, units.deg

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
    width_px = 1384,
    height_px = 1036,
    frame_rate = 15 * Hz,
    exposure = 5 * ms,
    effective_pixel = 14.3 * um, -- of the aerial image, measured with a ruled slide in its place
  },

  -- Looks along +y at the robot, past the eye: for judging, and for calibrations with a target.
  side_camera = {
    driver = "genicam",
    address = "genicam:127.0.0.2",
    width_px = 656,
    height_px = 490,
    frame_rate = 15 * Hz,
    exposure = 5 * ms,
    effective_pixel = 20.4 * um, -- of the scene
  },

  -- The operator's hands: protocols ask for the robot, the target and the vials by questions with names.
  sample = { driver = "operator" },

  -- A FireWire camera in its place: driver = "iidc", address = "iidc:00b09d0100a8f3d1" (its GUID), and for a Basler A602f
  -- shutter_unit = 20e-6. A camera of the system, or a video: driver = "opencv_camera", address = "video:/dev/video0".

  -- hid:VENDOR:PRODUCT, with :SERIAL where there are two of them, as here. The device has no watchdog and holds its voltages when
  -- the host dies: wire digital line 0 to the amplifiers' enable input, with the emergency stop in series. With
  -- heartbeat = 50 * Hz it toggles, for a one-shot and a safety relay: docs/how-to/heartbeat_line.md.
  coils = {
    driver = "usb3103",
    address = "hid:09db:009c:01A2B3C4",
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

  -- The transscleral ring: LEDs behind a current source of 0.1 A per volt, on a spare output of a second USB-3103. Every
  -- end of a run leaves it dark. full_current is what the eye and the LEDs bear.
  lamp = {
    driver = "led",
    address = "hid:09db:009c:01A2B3C5",
    output = 0,
    amperes_per_volt = 0.1,
    full_current = 0.35 * A,
    level = 1, -- during a run; rig.lamp:set_level() changes it
  },

  -- Carries the camera with the microscope along the light: its axis z focuses. Any byte during a motion would end it, so
  -- Vitreo is silent then; leave its rotary control alone. An MPC-200 in its place: driver = "sutter_mpc200", drive = 1; Zaber's:
  -- driver = "zaber", z = { device = 1 }.
  stage = {
    driver = "sutter_mp285",
    address = "serial:/dev/ttyUSB0",
    carries = "sensor",
    focus_axis = "z",
    travel_min = { -12 * mm, -12 * mm, -12 * mm },
    travel_max = { 12 * mm, 12 * mm, 12 * mm },
    speed = 1 * mm / s,
  },

  rotation_stage = {
    driver = "zaber",
    address = "serial:/dev/ttyUSB1",
    device = 1,
    travel_min = 0,
    travel_max = 350 * deg,
    speed = 20 * deg / s,
    max_speed = 40 * deg / s,
  },

  -- Any teslameter that speaks SCPI: what asks it for the field, and what its numbers mean.
  field_probe = {
    driver = "scpi_probe",
    address = "serial:/dev/ttyUSB2",
    baud_rate = 9600,
    question = "MEAS?",
    unit = 1 * mT,
    range = 100 * mT,
    axes = 3,
  },

  -- Steered by in scripts: rig.joystick:state().translation; the pedal as a dead-man in a script: rig.pedal:held(2). With
  -- dead_man = { 2 } the interlock itself lets no current flow unless pedal 2 is held: released or unplugged means zero.
  joystick = { driver = "spacemouse", address = "hid:256f:c635" },
  pedal = { driver = "foot_pedal", address = "hid:05f3:0268", layout = "xkeys_xk3" },

  -- Of what stands for the amplifiers in a dry run and under `vitreo emulate`: with the USB's frames, on which the set point
  -- gets there, the 50 ms that the model believes.
  truth = { coil_delay = 40 * ms },
}
