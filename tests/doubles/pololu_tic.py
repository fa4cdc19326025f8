"""A Pololu Tic stepper controller, asked by USB control transfers, with a motor and a carriage behind it.

Sources, named by their letters at the lines below:
  H    github pololu/pololu-tic-software include/tic_protocol.h (codes, offsets), include/tic.h (comments)
  L    the same, lib/tic_handle.c (encodings), lib/tic_settings.c (factory settings), lib/tic_device.c
  G    Tic Stepper Motor Controller User's Guide 0J71, pages as in the T834 edition 2001-2018: 68 to 75 (5.4 error
       handling), 89, 112 to 115 (variables), 122 to 132 (commands), 146 to 148 (USB encoding)
  G56  the same guide on the web, 5.6 homing; G414: 4.14 limit switches
SPDX-License-Identifier: Apache-2.0
"""

import math
import struct

from double import GONE, STALL, UsbDouble

# H: product ids and, in lib/tic_settings.c, the least start-up voltage in mV; G 70 names other fixed thresholds
# for "Low VIN" (T825 7.0 V, T834 2.1 V): those are taken where known.
PRODUCTS = {"T825": 0x00B3, "T834": 0x00B5, "T500": 0x00BD, "N825": 0x00C3, "T249": 0x00C9, "36v4": 0x00CB}
LOW_VIN_MV = {"T825": 7000, "T834": 2100, "T500": 3000, "N825": 7000, "T249": 5800, "36v4": 6100}

RESET, DEENERGIZED, SOFT_ERROR, WAITING_FOR_ERR, STARTING_UP, NORMAL = 0, 2, 4, 6, 8, 10  # H, G 112
INTENTIONAL, DRIVER, LOW_VIN, KILL, INPUT, SERIAL, TIMEOUT, SAFE_START, ERR_HIGH = (1 << bit for bit in range(9))  # H
HALT, POSITION, VELOCITY = 2, 3, 4  # H: TIC_INPUT_STATE_*
STEP, SAFE_START_WINDOW, STABILIZING, HOMING_PAUSE = 1e-3, 0.2, 0.010, 0.020  # -, G 125, G 73, G56 step 4


class PololuTic(UsbDouble):
    """The controller in Serial / I2C / USB mode, the motor and its switches."""

    OPTIONS = {
        **UsbDouble.OPTIONS,
        "model": "T825",
        "firmware": 0x0109,  # bcdDevice; G414: limit switches and go home need 1.06
        "serial": "00123456",
    }
    STATE = (
        "operation_state", "error_status", "errors_occurred", "energized", "position_uncertain", "position", "velocity",
        "carriage", "input_state", "target_position", "target_velocity", "planning_mode", "homing", "max_speed",
        "starting_speed", "max_accel", "max_decel", "step_mode", "current_limit_code", "decay_mode", "settings",
        "vin_mv", "driver_fault", "kill_switch", "reverse_switch_at", "forward_switch_at", "steps_taken", "resets",
    )
    VENDOR = 0x1FFB  # H

    def __init__(self, **options):
        self.vin_mv, self.driver_fault, self.kill_switch = 12000, False, False
        self.reverse_switch_at = self.forward_switch_at = None  # where on the carriage's way they close, in microsteps
        self.carriage, self.steps_taken, self.resets = 0.0, 0.0, 0
        self.settings = None
        super().__init__(**options)

    @property
    def PRODUCT(self):  # noqa: N802  the name is the frame's
        """Product id."""
        return PRODUCTS[self.model]

    # -- settings ------------------------------------------------------------------------------------------

    def _factory(self):
        """L tic_settings_fill_with_defaults at the offsets of H; what is not named there is 0."""
        settings = bytearray(256)
        settings[0x08] = 1  # auto clear driver error
        settings[0x53] = 2  # decelerate to hold
        settings[0x07] = 14
        struct.pack_into("<H", settings, 0x09, 1000)  # command timeout; also G 89
        struct.pack_into("<H", settings, 0x0C, 250)
        struct.pack_into("<H", settings, 0x10, LOW_VIN_MV[self.model])
        settings[0x31] = 0xFF  # no special current limit during an error
        struct.pack_into("<II", settings, 0x43, 0, 2000000)  # starting speed, max speed
        struct.pack_into("<II", settings, 0x4B, 0, 40000)  # max decel (0: as accel), max accel
        struct.pack_into("<I", settings, 0x61, 1000000)  # homing speed towards
        struct.pack_into("<I", settings, 0x65, 500000)  # homing speed away
        unit = {"T249": 40, "36v4": 71.615, "T500": 174}.get(self.model, 32)  # mA a step of the code
        settings[0x40] = int({"T249": 200, "36v4": 215, "T500": 174}.get(self.model, 192) / unit + 0.5)
        if self.model == "T500":
            settings[0x40] = 2  # tic_current_limit.c: 174 mA is code 2
        return bytes(settings)

    def _word(self, offset, form="<I"):
        return struct.unpack_from(form, self.settings, offset)[0]

    def _load_settings(self, now):
        """G 126: temporary changes are discarded."""
        accel = max(self._word(0x4F), 100)
        self.put(now, starting_speed=self._word(0x43), max_speed=self._word(0x47), max_accel=accel,
                 max_decel=self._word(0x4B) or accel,  # G 129: 0 means as the acceleration
                 step_mode=self.settings[0x41], current_limit_code=self.settings[0x40], decay_mode=self.settings[0x42])

    # -- start and time ------------------------------------------------------------------------------------

    def start(self, now):
        """Power-up. G 70: the intentionally de-energized bit is 0; G 112: nothing confirms the position yet."""
        if self.settings is None:
            self.settings = self._factory()
        self._begun = now
        self._gone = False
        self.put(now, operation_state=RESET, error_status=0, errors_occurred=0, energized=False,
                 position_uncertain=True, position=0.0, velocity=0.0, input_state=HALT, target_position=0,
                 target_velocity=0, planning_mode=0, homing="", intentional=False, timed_out=False)
        self._load_settings(now)
        self._last_command = now
        self._exit_safe_until = None
        self._left_reset = now
        self._homing_wait = None
        self._latched_fault = False
        self.now = now
        self._evaluate(now)

    def next_event(self):
        """The end of the command timeout, of the safe-start window, of the stabilizing time."""
        times = [self._timeout_at(), self._exit_safe_until, self._homing_wait]
        if self.operation_state == STARTING_UP:
            times.append(self._left_reset + STABILIZING)
        return min((each for each in times if each is not None and each > self.now), default=None)

    def _timeout_at(self):
        limit = self._word(0x09, "<H")
        if not limit or self.timed_out or self.settings[0x01] != 0:  # G 71: only in Serial / I2C / USB mode
            return None
        return self._last_command + limit * 1e-3

    def advance(self, now):
        """Runs time, motor and conditions on to this time."""
        while self.now < now:
            event = self.next_event()
            until = now if event is None else min(now, event)
            self._run(until)
            super().advance(until)
            self._evaluate(until)

    def arranged(self, now):
        """Switches, supply and faults act at once."""
        if self.driver_fault:
            self._latched_fault = True
        self._evaluate(now)

    # -- conditions, G 68 to 75 ----------------------------------------------------------------------------

    def _evaluate(self, now):
        """One look at all conditions; the first one of the table on G 68 that is true makes the state."""
        limit = self._timeout_at()
        if limit is not None and now >= limit - 1e-9:
            self.put(now, timed_out=True)
        if not self.driver_fault and self.settings[0x08]:
            self._latched_fault = False  # no source for the pause before the automatic clearing
        for _ in range(3):  # a state may make an error (safe start) that makes another state
            if not self._evaluate_once(now):
                break

    def _evaluate_once(self, now):
        errors = 0
        errors |= INTENTIONAL if self.intentional else 0
        errors |= DRIVER if self._latched_fault else 0
        errors |= LOW_VIN if self.vin_mv < LOW_VIN_MV[self.model] else 0
        errors |= KILL if self.kill_switch and self.settings[0x5D] else 0
        errors |= TIMEOUT if self.timed_out else 0
        if self._exit_safe_until is not None and now >= self._exit_safe_until:
            self._exit_safe_until = None
        # G 72: set whenever the Tic is not in the normal state; an exit command clears it for 200 ms
        if not self.settings[0x03] and self.settings[0x01] == 0:
            others = errors != 0 or self.operation_state != NORMAL or self._forced_safe_start
            if others and self._exit_safe_until is None:
                errors |= SAFE_START
        self._forced_safe_start = False
        if errors & (DRIVER | LOW_VIN):
            state = RESET
        elif errors & INTENTIONAL:
            state = DEENERGIZED
        elif errors:
            state = SOFT_ERROR
        else:
            if self.operation_state == RESET:
                self._left_reset = now
            # G 73: within 10 ms of resetting the stepper driver
            state = STARTING_UP if now < self._left_reset + STABILIZING - 1e-9 else NORMAL
        if state != RESET and self.operation_state == RESET:
            self._left_reset = now
        before = (self.operation_state, self.error_status)
        self.put(now, error_status=errors, errors_occurred=self.errors_occurred | errors)
        self._enter(state, now)
        return before != (self.operation_state, self.error_status)

    _forced_safe_start = False

    def _enter(self, state, now):
        was = self.operation_state
        if state == was:
            if state == NORMAL:
                self._obey(now)
            return
        self.put(now, operation_state=state)
        if state in (RESET, DEENERGIZED):
            # G 74, de-energize: the driver is disabled and no pulses are sent
            if self.energized or was == NORMAL:
                self._stop_at_once(now, uncertain=True)  # fact sheet: position uncertain; G 74 says so for a soft error
            self.put(now, energized=False, planning_mode=0)
        elif state == SOFT_ERROR and was == NORMAL:
            self.put(now, homing="")  # no source for homing in an error but that the motor is stopped
            self._homing_wait = None
            response = self.settings[0x53]  # G 74
            if response == 0:
                self._stop_at_once(now, uncertain=True)
                self.put(now, energized=False, planning_mode=0)
            elif response == 1:
                self._stop_at_once(now, uncertain=True)
                self.put(now, planning_mode=0)
            elif response == 2:
                self.put(now, planning_mode=2, target_velocity=0)
            else:
                self.put(now, planning_mode=1, target_position=self._word(0x54, "<i"))
        elif state in (STARTING_UP, NORMAL):
            self.put(now, energized=True)  # G 75
            if state == NORMAL:
                self._obey(now)

    def _obey(self, now):
        """G 75, obey input: what was asked last, also before an error, is done now."""
        if self.homing:
            return
        if self.input_state == POSITION:
            self.put(now, planning_mode=1, target_position=self._input)
        elif self.input_state == VELOCITY:
            self.put(now, planning_mode=2, target_velocity=self._input)
        else:
            self.put(now, planning_mode=0)

    _input = 0

    def _stop_at_once(self, now, uncertain):
        self.put(now, velocity=0.0)
        if uncertain:
            self.put(now, position_uncertain=True)

    # -- motion --------------------------------------------------------------------------------------------

    def _switch(self, forward, carriage=None):
        """Whether the limit switch of that direction is configured and closed."""
        carriage = self.carriage if carriage is None else carriage
        if not self.settings[0x5F if forward else 0x60]:  # H: LIMIT_SWITCH_FORWARD_MAP, REVERSE_MAP
            return False
        where = self.forward_switch_at if forward else self.reverse_switch_at
        if where is None:
            return False
        return carriage >= where if forward else carriage <= where

    def _run(self, until):
        """Moves the motor in steps of a millisecond; speeds in microsteps/s."""
        now = self.now
        if self.velocity == 0 and (self.planning_mode == 0 or not self.energized) and not self.homing:
            return
        while now < until - 1e-12:
            span = min(STEP, until - now)
            now += span
            self._step(span, now)
            if self.velocity == 0 and self._arrived() and not self.homing:
                return

    def _arrived(self):
        if self.planning_mode == 1:
            return self.position == self.target_position
        return self.planning_mode == 0 or self.target_velocity == 0

    def _step(self, span, now):
        if not self.energized:
            self.velocity = 0.0
            return
        top, start = self.max_speed * 1e-4, self.starting_speed * 1e-4  # H: microsteps per 10000 s
        accel, decel = self.max_accel * 1e-2, self.max_decel * 1e-2  # H: microsteps per 100 s^2
        left = None
        if self.homing:
            wanted = self._homing_velocity(now)
        elif self.planning_mode == 1:
            left = self.target_position - self.position
            wanted = math.copysign(min(top, max(math.sqrt(2 * decel * abs(left)), start)), left) if left else 0.0
        elif self.planning_mode == 2:
            wanted = min(max(self.target_velocity * 1e-4, -top), top)
        else:
            wanted = 0.0
            self.velocity = 0.0
        speeding = abs(wanted) > abs(self.velocity) and wanted * self.velocity >= 0
        change = (accel if speeding else decel) * span
        if abs(wanted - self.velocity) <= change or (abs(wanted) <= start and abs(self.velocity) <= start):
            self.velocity = wanted
        else:
            self.velocity += math.copysign(change, wanted - self.velocity)
            if abs(self.velocity) < start and speeding:
                self.velocity = math.copysign(min(start, abs(wanted)), wanted)
        move = self.velocity * span
        if left is not None and (abs(left) < 0.5 or (move * left > 0 and abs(move) >= abs(left))):
            move, self.velocity = left, 0.0
        if move and self._switch(forward=move > 0):
            # G414: a limit switch keeps the motor from going on; G56 step 3: it stops abruptly
            self.velocity, move = 0.0, 0.0
            if not self.homing:
                self.put(now, position_uncertain=True)  # no source for the flag after a limit switch
        self.position += move
        self.carriage += move
        self.steps_taken += abs(move)

    def _homing_velocity(self, now):
        """G56, the nine steps of the homing procedure."""
        forward = self.homing.startswith("forward")
        sign = 1 if forward else -1
        if self.homing.endswith("towards"):
            if self._switch(forward):
                self.velocity = 0.0
                self.put(now, homing=self.homing.replace("towards", "pause"))
                self._homing_wait = now + HOMING_PAUSE
                return 0.0
            return sign * self._word(0x61) * 1e-4
        if self.homing.endswith("pause"):
            if now < self._homing_wait:
                return 0.0
            self._homing_wait = None
            self.put(now, homing=self.homing.replace("pause", "away"))
        if not self._switch(forward):
            self.velocity = 0.0
            self.put(now, homing="", position=0.0, position_uncertain=False, input_state=HALT, planning_mode=0)
            return 0.0
        return -sign * self._word(0x65) * 1e-4

    # -- USB -----------------------------------------------------------------------------------------------

    def control(self, request_type, request, value, index, length_or_data, now):
        """One control transfer; H and G 146 to 148 for the forms."""
        if self._gone:
            return (GONE, b"") if request_type & 0x80 else GONE
        self.advance(now)
        if request_type & 0x80:
            return self._read(request_type, request, value, index, length_or_data, now)
        if request_type != 0x40:
            return self._refuse(now, request_type, request)
        if length_or_data:
            return self._refuse(now, request_type, request)  # G 146: wLength is 0; no source for the answer otherwise
        act = self._COMMANDS.get(request)
        if act is None or (request == 0x97 and self.firmware < 0x0106):  # G414: firmware 1.06 or later
            return self._refuse(now, request_type, request)
        self.tell(now, act, value | index << 16)
        # G 71: these, and reset command timeout, start the period anew and clear the error
        if request in (0xE0, 0xE3, 0xEC, 0x89, 0x85, 0x83, 0xB0, 0x8C):
            self._last_command = now
            self.put(now, timed_out=False)
        getattr(self, "_" + act)(value, index, now)
        self._evaluate(now)
        return 0

    _COMMANDS = {  # H: TIC_CMD_*
        0xE0: "set_target_position", 0xE3: "set_target_velocity", 0xEC: "halt_and_set_position", 0x89: "halt_and_hold",
        0x97: "go_home", 0x8C: "reset_command_timeout", 0x86: "deenergize", 0x85: "energize", 0x83: "exit_safe_start",
        0x8F: "enter_safe_start", 0xB0: "reset", 0x8A: "clear_driver_error", 0xE6: "set_max_speed",
        0xE5: "set_starting_speed", 0xEA: "set_max_accel", 0xE9: "set_max_decel", 0x94: "set_step_mode",
        0x91: "set_current_limit", 0x92: "set_decay_mode", 0x98: "set_agc_option", 0x13: "set_setting",
        0x10: "reinitialize", 0xFF: "start_bootloader",
    }

    def _refuse(self, now, request_type, request):
        self.tell(now, "refused", [request_type, request])
        return STALL  # no source but USB 2.0 9.2.7: a request that is not supported is stalled

    def _read(self, request_type, request, value, index, length, now):
        if request_type == 0x80 and request == 6:
            return self._descriptor(value, length)
        if request_type != 0xC0 or request not in (0xA1, 0xA2, 0xA8):
            return self._refuse(now, request_type, request), b""
        if length > 128:  # H: TIC_MAX_USB_RESPONSE_SIZE; no source for the answer beyond it
            return self._refuse(now, request_type, request), b""
        space = self.settings if request == 0xA8 else self._variables(now)
        data = space[index & 0xFF:(index & 0xFF) + length]
        if request == 0xA2:
            self.put(now, errors_occurred=0)  # G 132: also clears it; what is wrong still is set again at once
            self._evaluate(now)
        return len(data), data

    def _descriptor(self, value, length):
        """USB 2.0 9.6: device and string descriptors; L tic_device.c: string 3 the serial number, 4 the modification."""
        kind, number = value >> 8, value & 0xFF
        if kind == 1:
            data = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x200, 0, 0, 0, 8, self.VENDOR, self.PRODUCT, self.firmware, 1, 2, 3, 1)
        elif kind == 3 and number == 0:
            data = b"\x04\x03\x09\x04"
        elif kind == 3 and number in (1, 2, 3, 4):
            text = ("Pololu Corporation", "Tic", self.serial, "-")[number - 1].encode("utf-16-le")
            data = bytes([2 + len(text), 3]) + text
        else:
            return STALL, b""
        return len(data[:length]), data[:length]

    def _variables(self, now):
        """H: TIC_VAR_*; G 112 to 115 for their types; all little-endian."""
        space = bytearray(256)
        space[0x00] = self.operation_state
        # H: TIC_MISC_FLAGS1_*
        space[0x01] = (self.energized | self.position_uncertain << 1 | self._switch(True) << 2
                       | self._switch(False) << 3 | bool(self.homing) << 4)
        struct.pack_into("<HI", space, 0x02, self.error_status, self.errors_occurred)
        space[0x09] = self.planning_mode
        struct.pack_into("<iiIIIIii", space, 0x0A, self.target_position, self.target_velocity, self.starting_speed,
                         self.max_speed, self.max_decel, self.max_accel, int(self.position), round(self.velocity * 1e4))
        struct.pack_into("<HI", space, 0x33, self.vin_mv, int((now - self._begun) * 1e3) & 0xFFFFFFFF)
        space[0x49], space[0x4A], space[0x4B] = self.step_mode, self.current_limit_code, self.decay_mode
        space[0x4C] = self.input_state
        if self.input_state in (POSITION, VELOCITY):
            struct.pack_into("<i", space, 0x51, self._input)
        return bytes(space)

    # -- commands, G 122 to 132 ----------------------------------------------------------------------------

    @staticmethod
    def _signed(value, index):
        number = value | index << 16  # G 147: low word in wValue, high word in wIndex
        return number - (1 << 32) if number & 0x80000000 else number

    def _aim(self, state, number, now):
        if self.settings[0x01] != 0:
            return  # G 122: silently ignored in another control mode
        self.put(now, homing="")
        self._homing_wait = None
        self._input = number
        self.put(now, input_state=state)

    def _set_target_position(self, value, index, now):
        self._aim(POSITION, self._signed(value, index), now)

    def _set_target_velocity(self, value, index, now):
        self._aim(VELOCITY, self._signed(value, index), now)

    def _halt_and_set_position(self, value, index, now):
        if self.settings[0x01] != 0:
            return
        self._aim(HALT, 0, now)
        self._stop_at_once(now, uncertain=False)
        self.put(now, position=float(self._signed(value, index)), position_uncertain=False, planning_mode=0)

    def _halt_and_hold(self, value, index, now):
        if self.settings[0x01] != 0:
            return
        self._aim(HALT, 0, now)
        self._stop_at_once(now, uncertain=True)
        self.put(now, planning_mode=0)

    def _go_home(self, value, index, now):
        self.put(now, position_uncertain=True)  # G56 step 1
        if self.operation_state == NORMAL:  # no source for a command in an error; nothing moves then anyway
            self.put(now, homing=("forward" if value else "reverse") + " towards")

    def _reset_command_timeout(self, value, index, now):
        """Nothing more than the period that starts anew."""

    def _deenergize(self, value, index, now):
        self.put(now, intentional=True)

    def _energize(self, value, index, now):
        self.put(now, intentional=False)

    def _exit_safe_start(self, value, index, now):
        self._exit_safe_until = now + SAFE_START_WINDOW  # G 125

    def _enter_safe_start(self, value, index, now):
        self._exit_safe_until = None
        self._forced_safe_start = True  # G 72: set the next time the Tic evaluates it

    def _reset(self, value, index, now):
        """G 126; the intentional bit stays."""
        self._load_settings(now)
        self._stop_at_once(now, uncertain=True)
        self.put(now, resets=self.resets + 1, operation_state=RESET, energized=False, input_state=HALT, position=0.0,
                 errors_occurred=0, homing="", planning_mode=0, timed_out=False)
        self._exit_safe_until = None

    def _clear_driver_error(self, value, index, now):
        self._latched_fault = self.driver_fault

    def _set_max_speed(self, value, index, now):
        self.put(now, max_speed=min(value | index << 16, 500000000))  # H; no source for a value beyond: taken as the most

    def _set_starting_speed(self, value, index, now):
        self.put(now, starting_speed=min(value | index << 16, 500000000))

    def _set_max_accel(self, value, index, now):
        self.put(now, max_accel=min(max(value | index << 16, 100), 0x7FFFFFFF))  # H; G 129: below 100 it is 100

    def _set_max_decel(self, value, index, now):
        number = value | index << 16
        self.put(now, max_decel=min(max(number, 100), 0x7FFFFFFF) if number else self.max_accel)  # G 129

    def _set_step_mode(self, value, index, now):
        modes = {"T249": range(7), "36v4": (0, 1, 2, 3, 4, 5, 7, 8, 9)}.get(self.model, range(6))
        if self.model == "T500":
            modes = range(4)  # the T500's driver goes to 1/8 step; no source at hand but its product page
        if value in modes:
            self.put(now, step_mode=value)
        else:
            self.tell(now, "refused step mode", value)  # no source for what the Tic does

    def _set_current_limit(self, value, index, now):
        most = {"T834": 3456 // 32, "T249": 4480 // 40, "T500": 32, "36v4": 127}.get(self.model, 3968 // 32)  # H
        self.put(now, current_limit_code=min(value & 0x7F, most))  # no source for a code beyond: taken as the most

    def _set_decay_mode(self, value, index, now):
        self.put(now, decay_mode=value)

    def _set_agc_option(self, value, index, now):
        """Only the T249 has it; nothing here depends on it."""

    def _set_setting(self, value, index, now):
        """G 148: a byte in wValue, an offset in wIndex; kept without power, in force after reinitialize or reset."""
        settings = bytearray(self.settings)
        settings[index & 0xFF] = value & 0xFF
        self.put(now, settings=bytes(settings))

    def _reinitialize(self, value, index, now):
        self._load_settings(now)  # H tic.h: applies new settings seamlessly if possible

    def _start_bootloader(self, value, index, now):
        self._gone = True  # G 5.7: the Tic leaves the bus and comes back as its bootloader
        self._stop_at_once(now, uncertain=True)
        self.put(now, energized=False)


DOUBLE = PololuTic
