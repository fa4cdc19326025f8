"""A Newport CONEX-CC controller with a DC servo actuator.

Sources, named by their letters at the lines below:
  QMI  a public driver of the CONEX-CC (QMI's Newport_ConexCC_Controller): states, positioner errors, VE, TB, PW
  YAQ  github yaq-project/yaqd-newport _newport_motor.py: command errors, states, what is asked
  PM   github pymeasure/pymeasure newport/smc100.py, same command errors
  MM   github micro-manager/mmCoreAndDevices NewportCONEX/Conex_Axis.cpp: what is sent, what is cut out of answers
  PIT  duttlab-sys/pittqlabsys-single-NV newport_conex_cc.py: CR LF, 921600 baud, states
  F    the project's fact sheet scripted_instruments, "Also"
SPDX-License-Identifier: Apache-2.0
"""

import re

from double import ByteDouble
from motion import Motor

# YAQ error_dict, PM CommandError
ERRORS = {
    "@": "No error", "A": "Unknown message code or floating point controller address", "B": "Controller address not correct",
    "C": "Parameter missing or out of range", "D": "Command not allowed", "E": "Home sequence already started",
    "G": "Displacement out of limits", "H": "Command not allowed in NOT REFERENCED state",
    "I": "Command not allowed in CONFIGURATION state", "J": "Command not allowed in DISABLE state",
    "K": "Command not allowed in READY state", "L": "Command not allowed in HOMING state",
    "M": "Command not allowed in MOVING state", "N": "Current position out of software limit",
    "S": "Communication time-out", "U": "Error during EEPROM access", "V": "Error during command execution",
}
# QMI STATE_TABLE: number -> kind
NOT_REFERENCED, CONFIGURATION, HOMING, MOVING, READY, DISABLE = "H", "I", "L", "M", "K", "J"  # the letter of its error
KINDS = {**{n: NOT_REFERENCED for n in range(0x0A, 0x12)}, 0x14: CONFIGURATION, 0x1E: HOMING, 0x28: MOVING,
         0x32: READY, 0x33: READY, 0x34: READY, 0x3C: DISABLE, 0x3D: DISABLE}
END_POSITIVE, END_NEGATIVE, FOLLOWING, HOMING_LATE = 0x0002, 0x0001, 0x0020, 0x0040  # QMI bits 14, 15, 10, 9 from the left
UNITS = 1e6  # of the motor for a millimetre
FLASH = 100  # writes; QMI: the device supports up to 100

# What may be set: name -> (default, least, most). MM, QMI; no source for the ranges
SETTINGS = {"VA": (0.4, 1e-6, 1e12), "AC": (1.6, 1e-6, 1e12), "SL": (0.0, -1e12, 0.0), "SR": (25.0, 0.0, 1e12),
            "OT": (60.0, 1.0, 1000.0), "SU": (1.0, 1e-6, 1e12), "OH": (0.2, 1e-6, 1e12)}
IN_CONFIGURATION_ONLY = ("OT", "SU", "OH")  # QMI setup_...: PW1 first


class Refused(Exception):
    """A command error."""


class NewportConex(ByteDouble):
    """The controller and the actuator."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "address": 1,  # QMI: always 1
        "version": "CONEX-CC 1.0.6",  # no source for the number; QMI: model and version are two words
        "travel": 25.0,  # mm
        "reset": 3.0,  # s of silence after RS; YAQ waits 5. no source for the time
        "flash": 2.0,  # s of silence after PW0; QMI: asking then times out. no source for the time
        "ready_lag": 0.05,  # s after PA or PR in which TS still says READY: F, YAQ ignores five. no source for the time
        "chatty": False,  # an empty line ahead of each answer
    }
    STATE = ("position", "rail", "state_code", "error", "positioner_error", "settings", "lasting", "writes", "blocked",
             "unheard", "velocity")

    def __init__(self, **options):
        self.lasting, self.blocked, self.writes, self.unheard = None, False, 0, 0
        self._motor = None
        super().__init__(**options)

    def start(self, now):
        """Power-up: parameters from the flash, not referenced (QMI 0A)."""
        if self.lasting is None:
            self.lasting = {name: values[0] for name, values in SETTINGS.items()}
            self.lasting["SR"] = self.travel
            self._motor = Motor(0.3 * self.travel * UNITS, 1.0, 1.0)
        self._motor.halt()
        self._motor.now = now
        self._origin = self._motor.position  # no source: where it is is zero before homing
        self._line, self._deaf_until, self._lag_until, self._home_by = bytearray(), now, now, None
        self.put(now, state_code=0x0A, error="@", positioner_error=0, settings=dict(self.lasting))
        self.now = now

    position = property(lambda self: (self._motor.position - self._origin) / UNITS)
    velocity = property(lambda self: self._motor.velocity / UNITS)

    @property
    def rail(self):
        """Where the actuator is, in mm from its home switch."""
        return self._motor.position / UNITS

    @property
    def _kind(self):
        return KINDS[self.state_code]

    # -- time ----------------------------------------------------------------------------------------------

    def next_event(self):
        """The end of a movement is looked for every 5 ms."""
        return self.now + 0.005 if self._kind in (MOVING, HOMING) else None

    def advance(self, now):
        """Moves on."""
        while self.now < now:
            until = min(now, self.now + 0.005) if self._kind in (MOVING, HOMING) else now
            self._move(until)
            super().advance(until)

    def _move(self, until):
        if self._kind not in (MOVING, HOMING):
            self._motor.now = until
            return
        if self.blocked:
            self._motor.halt()
            self.put(until, positioner_error=self.positioner_error | FOLLOWING)
            self._become(0x3D if self._kind == MOVING else 0x0B, until)  # no source for what follows a following error
            return
        at_end = self._motor.run(until, 0.0, self.travel * UNITS)
        if self._kind == HOMING and self._home_by is not None and until > self._home_by:
            self._motor.halt()
            self.put(until, positioner_error=self.positioner_error | HOMING_LATE)
            self._become(0x0B, until)
        elif at_end and self._kind == MOVING:
            bit = END_POSITIVE if self._motor.position > 0 else END_NEGATIVE
            self.put(until, positioner_error=self.positioner_error | bit)
            self._become(0x3D, until)
        elif not self._motor.busy:
            if self._kind == HOMING:
                self._origin = self._motor.position
            self._become(0x32 if self._kind == HOMING else 0x33, until)

    def _become(self, code, now):
        self.put(now, state_code=code)

    # -- the line ------------------------------------------------------------------------------------------

    def take(self, byte, now):
        """PIT: executed only after CR LF; less strict: either."""
        if now < self._deaf_until:
            self.unheard += 1
            return
        if byte == 0x0A and (not self.strict or self._line.endswith(b"\r")):
            line = self._line.decode("latin-1").strip()
            self._line.clear()
            if line:
                self._received(line, now)
        elif byte == 0x0D and not self.strict:
            self.take(0x0A, now)
        else:
            self._line.append(byte)

    def _received(self, line, now):
        self.tell(now, "line", line)
        form = re.fullmatch(r"(\d+)([A-Z]{2})\s*(.*)", line)
        try:
            if not form:
                raise Refused("A")
            if int(form[1]) != self.address:
                return  # no source: another controller's, on a CONEX there is none
            told = self._act(form[2], form[3].strip(), now)
        except Refused as letter:
            self.put(now, error=str(letter))  # F: set commands do not answer; the error is asked for
            return
        if told is not None:
            text = f"{self.address}{form[2]}{told}\r\n"
            self.answer((("\r\n" if self.chatty else "") + text).encode("latin-1"), now)

    def _act(self, name, argument, now):
        if name in SETTINGS:
            return self._setting(name, argument, now)
        ask = {"TP": self._tell_position, "TH": self._tell_target, "TS": self._tell_state, "TE": self._tell_error,
               "VE": lambda a, now: " " + self.version}
        act = {"OR": self._home, "PA": self._absolute, "PR": self._relative, "ST": self._stop, "MM": self._mode,
               "RS": self._reset, "PW": self._program, "TB": self._tell_text}
        if name in ask:
            if argument not in ("", "?"):
                raise Refused("C")
            return ask[name](argument, now)
        if name not in act:
            raise Refused("A")
        return act[name](argument, now)

    @staticmethod
    def _number(text):
        if not re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)(E[-+]?\d+)?", text.upper()):
            raise Refused("C")
        return float(text)

    # -- questions -----------------------------------------------------------------------------------------

    def _tell_position(self, argument, now):
        return f"{self.position:.6f}".rstrip("0").rstrip(".") if self.position else "0"  # F: 1TP3.141

    def _tell_target(self, argument, now):
        at = self._motor.target if self._motor.target is not None else self._motor.position
        return f"{(at - self._origin) / UNITS:.6f}".rstrip("0").rstrip(".") or "0"

    def _tell_state(self, argument, now):
        """F, MM: four hexadecimal digits of errors, two of the state."""
        code = self.state_code
        if self._kind == MOVING and now < self._lag_until:
            code = self._before
        return f"{self.positioner_error:04X}{code:02X}"

    def _tell_error(self, argument, now):
        told = self.error
        self.put(now, error="@")  # no source here but F's and YAQ's habit of asking once a command: it is forgotten
        return told

    def _tell_text(self, argument, now):
        letter = (argument or self.error)[:1].upper()
        if letter not in ERRORS:
            raise Refused("C")
        return f"{letter} {ERRORS[letter]}"  # QMI: the text behind the first blank

    # -- settings ------------------------------------------------------------------------------------------

    def _setting(self, name, argument, now):
        if argument == "?":
            return f"{self.settings[name]:g}"
        if name in IN_CONFIGURATION_ONLY and self._kind != CONFIGURATION:
            raise Refused("D" if self._kind not in (READY, NOT_REFERENCED) else self._kind)
        if self._kind in (HOMING, MOVING):
            raise Refused(self._kind)
        if self._kind == NOT_REFERENCED:
            raise Refused("H")  # YAQ, QMI: settings are changed in CONFIGURATION (lasting) or in READY (until power-off)
        value = self._number(argument)
        least, most = SETTINGS[name][1:]
        if not least <= value <= most:
            raise Refused("C")
        self.put(now, settings={**self.settings, name: value})
        return None

    def _program(self, argument, now):
        """QMI: PW1 from NOT REFERENCED to CONFIGURATION, PW0 back; that writes the flash."""
        if argument == "?":
            return str(int(self._kind == CONFIGURATION))
        if argument not in ("0", "1"):
            raise Refused("C")
        if argument == "1" and self._kind == NOT_REFERENCED:
            self._become(0x14, now)
        elif argument == "0" and self._kind == CONFIGURATION:
            self.put(now, lasting=dict(self.settings), writes=self.writes + 1)
            if self.writes > FLASH:
                self.tell(now, "flash worn", self.writes)
            self._deaf_until = now + self.flash
            self._become(0x0C, now)
        elif not (argument == "1" and self._kind == CONFIGURATION):
            raise Refused(self._kind)
        return None

    # -- movements -----------------------------------------------------------------------------------------

    def _home(self, argument, now):
        if argument:
            raise Refused("C")
        if self._kind == HOMING:
            raise Refused("E")
        if self._kind != NOT_REFERENCED:
            raise Refused(self._kind)
        self._motor.speed, self._motor.accel = self.settings["OH"] * UNITS, self.settings["AC"] * UNITS
        self._motor.go(0.0)
        self._home_by = now + self.settings["OT"]
        self.put(now, positioner_error=0)
        self._become(0x1E, now)

    def _absolute(self, argument, now):
        if argument == "?":
            return self._tell_target("", now)
        return self._go(self._number(argument), now)

    def _relative(self, argument, now):
        return self._go(self.position + self._number(argument), now)

    def _go(self, target, now):
        if self._kind != READY:
            raise Refused(self._kind)
        if not self.settings["SL"] - 1e-9 <= target <= self.settings["SR"] + 1e-9:
            raise Refused("G")
        self._before, self._lag_until = self.state_code, now + self.ready_lag
        self._motor.speed, self._motor.accel = self.settings["VA"] * UNITS, self.settings["AC"] * UNITS
        self._motor.go(target * UNITS + self._origin)
        self.put(now, positioner_error=0)
        self.tell(now, "move", target)
        self._become(0x28, now)

    def _stop(self, argument, now):
        if self._kind in (NOT_REFERENCED, CONFIGURATION, DISABLE, HOMING):
            raise Refused(self._kind)
        if self._kind == MOVING:
            self._motor.turn(0.0)
            self._lag_until = now

    def _mode(self, argument, now):
        """MM: MM0 to DISABLE, MM1 back."""
        if argument == "?":
            return str(int(self._kind != DISABLE))
        if argument not in ("0", "1"):
            raise Refused("C")
        if argument == "0" and self._kind == READY:
            self._become(0x3C, now)
        elif argument == "1" and self._kind == DISABLE:
            self.put(now, positioner_error=0)
            self._become(0x34, now)
        elif self._kind not in (READY, DISABLE):
            raise Refused(self._kind)

    def _reset(self, argument, now):
        """YAQ: RS, then waits for NOT REFERENCED. What was set and not written is lost (QMI: equivalent to a power-up)."""
        if argument:
            raise Refused("C")
        self.start(now)
        self._deaf_until = now + self.reset


DOUBLE = NewportConex
