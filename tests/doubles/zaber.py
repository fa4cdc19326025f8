"""A Zaber device with the ASCII protocol: one or more linear axes.

Sources, named by their letters at the lines below:
  Z    github stphnt/zproto (src/ascii/packet/test.rs, checksum.rs, port/test.rs, README)
  ML   Zaber's own Matlab toolbox, tests of its AsciiDevice (replies a device gives to it)
  ALPHA  zaber.com/wiki/ASCII: framing, characters
  MAN  zaber.com/wiki/Manuals/ASCII_Protocol_Manual (firmware 6): conventions; what else of it stands here comes from
       the project's fact sheet zaber_ascii (F), which quotes it
  AZM  github freudenthal/ArduinoZaberMaster: reject reasons
  MM   Micro-Manager DeviceAdapters/Zaber: the factor 1.6384
SPDX-License-Identifier: Apache-2.0
"""

import re

from double import ByteDouble
from motion import Motor

# F: in the order of their priority, the first one that is set is shown.
FLAGS = ("FF FN FZ FH FV FO FC FM FD FQ FI FA FR FS FB FP FE FT "
         "WL WV WT WS WM WP WR WH NC NI ND NR NT NU NJ NB").split()
FACTOR = 1.6384  # MM, F: speed data = microsteps/s * 1.6384; acceleration data = microsteps/s^2 * 1.6384 / 10000


class Reject(Exception):
    """A reason for RJ."""


def checksum(body):
    """Z checksum.rs: two's complement of the low byte of the sum, two hex digits."""
    return f"{-sum(body.encode('latin-1')) & 0xFF:02X}"


class Axis:
    """One axis: its motor, its flags and what it is doing."""

    def __init__(self, travel):
        self.travel = travel
        # The rail is where it is; the device's idea of it (pos) is lost without power.
        self.motor = Motor(0.4 * travel, 1.0, 1.0)
        self.offset = 0.0  # pos = rail - offset
        self.flags = set()
        self.knob = 0.0
        self.parked = False
        self.enabled = True
        self.doing = ""  # home, move or empty

    @property
    def pos(self):
        """What the device believes."""
        return self.motor.position - self.offset

    @property
    def busy(self):
        """BUSY or IDLE."""
        return self.motor.busy


class Zaber(ByteDouble):
    """The device."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "address": 1,
        "axes": 1,
        "firmware": "6.28",  # or 7.xx: system.access, move abs with a speed, driver enable, FO
        "device_id": 50081,
        "serial": 34567,
        "travel": 1066667.0,  # F: 0.047625 um a microstep, 50.8 mm
        "info": False,  # an info line behind each reply, as Z port/test.rs has them
    }
    STATE = (
        "lasting", "positions", "rails", "velocities", "flags", "parked", "enabled", "knobs", "push", "forced_flags",
        "voltage", "temperature", "resets",
    )

    # name: (scope, default, least, greatest, lasting); F for the names, Z src/ascii/setting for the scopes.
    # no source: ranges, and the defaults but those of F.
    SETTINGS = {
        "comm.address": ("device", 1, 1, 99), "comm.alert": ("device", 0, 0, 1), "comm.checksum": ("device", 0, 0, 1),
        "system.led.enable": ("device", 1, 0, 1), "maxspeed": ("axis", 153600, 1, 1000000),
        "accel": ("axis", 205, 0, 32767), "limit.min": ("axis", 0, -1000000000, 1000000000),
        "limit.max": ("axis", 1066667, -1000000000, 1000000000), "resolution": ("axis", 64, 1, 256),
        "knob.enable": ("axis", 1, 0, 1),
    }

    def __init__(self, **options):
        self.lasting = None
        self.forced_flags, self.voltage, self.temperature, self.resets, self.push = [], 24.0, 31.5, 0, 0
        super().__init__(**options)

    def start(self, now):
        """Power-up: settings last, the reference position does not (flag WR, F)."""
        if self.lasting is None:
            self.lasting = self._factory()
            self._axes = [Axis(self.travel) for _ in range(self.axes)]
        self._line = None
        self._waiting = False
        for axis in self._axes:
            axis.motor.halt()
            axis.motor.now = now
            axis.doing, axis.knob, axis.enabled = "", 0.0, True
            if axis.parked:  # F tools parking: the position is kept
                axis.flags = set()
            else:
                axis.flags = {"WR"}
                axis.offset = axis.motor.position - self.travel  # no source: what pos is before homing
        self.now = now

    def _factory(self):
        values = {}
        for name, (scope, default, _, _) in self.SETTINGS.items():
            values[name] = default if scope == "device" else [default] * self.axes
        values["comm.address"] = self.address
        values["limit.max"] = [round(self.travel)] * self.axes
        return values

    # Told to a test.
    positions = property(lambda self: [round(axis.pos) for axis in self._axes])
    velocities = property(lambda self: [axis.motor.velocity for axis in self._axes])
    flags = property(lambda self: [sorted(self._flags(axis), key=FLAGS.index) for axis in self._axes])
    parked = property(lambda self: [axis.parked for axis in self._axes])
    enabled = property(lambda self: [axis.enabled for axis in self._axes])

    @property
    def rails(self):
        """Where the carriages are on their rails."""
        return [axis.motor.position for axis in self._axes]

    @property
    def knobs(self):
        """Velocities that hands make at the knobs, in microsteps/s."""
        return [axis.knob for axis in self._axes]

    def arrange(self, now, **changes):
        """knobs: turns them; push: moves the carriages by hand without the device's knowledge."""
        knobs, push = changes.pop("knobs", None), changes.pop("push", None)
        super().arrange(now, **changes)
        for axis, velocity in zip(self._axes, knobs or []):
            self._turn_knob(axis, velocity, now)
        if push:
            self.tell(now, "push", push)
            for axis in self._axes:
                axis.motor.position += push
                axis.offset += push  # pos stays: nothing measures it
        self.advance(now)

    def _turn_knob(self, axis, velocity, now):
        number = self._axes.index(axis)
        axis.knob = velocity
        self.tell(now, "knob", [number + 1, velocity])
        if not self.lasting["knob.enable"][number] or axis.parked or not axis.enabled:
            return
        if velocity and axis.doing:
            axis.flags.add("NI")  # F: movement interrupted; Z README: `stop` within a move is answered with NI
            axis.doing = ""
        if velocity:
            axis.flags.add("NC")  # F: manual control
            axis.motor.accel = 1e6
            axis.motor.turn(velocity)
        elif "NC" in axis.flags:
            axis.motor.turn(0.0)

    # -- time ----------------------------------------------------------------------------------------------

    def next_event(self):
        """While something moves its end is looked for every 5 ms, for alerts."""
        return self.now + 0.005 if any(axis.busy for axis in self._axes) else None

    def advance(self, now):
        """Moves all axes on."""
        while self.now < now:
            until = min(now, self.now + 0.005) if any(axis.busy for axis in self._axes) else now
            for number, axis in enumerate(self._axes, 1):
                was = axis.busy
                end = axis.motor.run(until, 0.0, axis.travel)
                if end and axis.doing == "home":
                    end = False
                if end:
                    axis.flags.add("FS")  # F: stalled and stopped
                    axis.doing = ""
                    self.tell(until, "stalled", number)
                if was and not axis.busy:
                    self._stopped(axis, number, until)
            super().advance(until)

    def _stopped(self, axis, number, now):
        if axis.doing == "home":
            axis.offset = axis.motor.position  # the home sensor is at the start of the rail
            axis.flags -= {"WR", "WH"}  # F: stay until homed
        axis.doing = ""
        if not axis.knob:
            axis.flags.discard("NC")
        self.tell(now, "idle", [number, round(axis.pos)])
        if self.lasting["comm.alert"]:
            # F: !DD A IDLE|BUSY WW [data]; Z packet/test.rs "!01 2 IDLE -- "
            self._send(f"!{self._address:02d} {number} IDLE {self._warning([axis])}", now)

    # -- the line ------------------------------------------------------------------------------------------

    @property
    def _address(self):
        return self.lasting["comm.address"]

    def _send(self, text, now):
        if self.lasting["comm.checksum"]:
            text += ":" + checksum(text[1:])  # F: over all bytes after the first character
        self.answer(text.encode("latin-1") + b"\r\n", now)  # ALPHA, MAN: always CR LF

    def take(self, byte, now):
        """ALPHA: a command starts with /, ends with CR, LF or both; BS and DEL; others discard it."""
        if byte in (0x0D, 0x0A):
            line, self._line = self._line, None
            if line is not None:
                self._command(line, now)
        elif self._line is None:  # no source: bytes before the / are passed over
            self._line = "" if byte == ord("/") else None
        elif byte == 0x08:
            self._line = self._line[:-1]
        elif byte == 0x7F or not 0x20 <= byte < 0x7F:
            self._line = None
        else:
            self._line += chr(byte)

    def _command(self, line, now):
        self.tell(now, "line", line)
        if len(line) > 78:  # F: 80 bytes a packet; no source for what a longer one does: it is dropped
            return
        form = re.fullmatch(r"(.*?):([0-9A-Fa-f]{2})", line)
        if form:
            if int(checksum(form[1]), 16) != int(form[2], 16):
                self.tell(now, "bad checksum", line)
                return  # F: ignored without a reply
            line = form[1]
        # Z packet/test.rs: /1 2 3hi is device 1, axis 2, id 3, data "hi"; blanks may be more than one
        form = re.fullmatch(r"\s*(?:(\d{1,2})(?:\s+(\d)(?!\d)(?:\s+(\d{1,2}|--))?)?)?\s*(.*?)\s*", line)
        device, number, message, data = int(form[1] or 0), int(form[2] or 0), form[3], form[4]
        if device not in (0, self._address):
            return
        heard = f"@{self._address:02d} {number}" + (f" {int(message):02d}" if message and message != "--" else "")
        try:
            if number > len(self._axes):
                raise Reject("BADAXIS")  # AZM
            axes = self._axes if number == 0 else [self._axes[number - 1]]
            told = self._act(data.split(), number, axes, now)
            flag = "OK"
        except Reject as reason:
            axes = self._axes if number == 0 or number > len(self._axes) else [self._axes[number - 1]]
            told, flag = str(reason), "RJ"
        if message != "--":
            heard = heard.replace(heard[:3], f"@{self._address:02d}", 1)
            busy = "BUSY" if any(axis.busy for axis in axes) else "IDLE"
            self._send(f"{heard} {flag} {busy} {self._warning(axes)} {told}", now)
            if self.info:
                self._send(f"#{self._address:02d} {number} info message", now)

    def _flags(self, axis):
        return axis.flags | set(self.forced_flags) | ({"FO"} if not axis.enabled else set())

    def _warning(self, axes):
        present = set().union(*(self._flags(axis) for axis in axes))
        return next((flag for flag in FLAGS if flag in present), "--")

    # -- commands ------------------------------------------------------------------------------------------

    @property
    def _seven(self):
        return self.firmware.startswith("7")

    def _act(self, words, number, axes, now):
        if not words:
            return "0"  # F, ML: an empty command asks for the status
        word, rest = words[0], words[1:]
        act = {
            "home": self._home, "move": self._move, "stop": self._stop, "estop": self._stop_at_once, "get": self._get,
            "set": self._set, "warnings": self._warnings, "renumber": self._renumber, "system": self._system,
            "tools": self._tools, "driver": self._driver,
        }.get(word)
        if act is None:
            raise Reject("BADCOMMAND")  # ML, AZM
        return act(rest, number, axes, now)

    def _may_move(self, axes):
        for axis in axes:
            if axis.parked:
                raise Reject("PARKED")  # AZM
            if not axis.enabled:
                raise Reject("DRIVERDISABLED")  # F, firmware 7

    def _begin(self, axis, doing):
        if axis.busy:
            axis.flags.add("NI")  # F, Z README
        else:
            axis.flags.discard("NI")  # no source for when NI goes: here with the next movement that starts from rest
        axis.flags -= {"NC", "FS"}
        axis.doing = doing
        number = self._axes.index(axis)
        axis.motor.speed = self.lasting["maxspeed"][number] / FACTOR
        axis.motor.accel = max(self.lasting["accel"][number], 1) * 10000 / FACTOR

    @staticmethod
    def _whole(text):
        if not re.fullmatch(r"-?\d+", text):
            raise Reject("BADDATA")
        return int(text)

    def _home(self, rest, number, axes, now):
        if rest:
            raise Reject("BADDATA")
        self._may_move(axes)
        for axis in axes:
            self._begin(axis, "home")
            axis.motor.go(0.0)
        return "0"

    def _move(self, rest, number, axes, now):
        kinds = {"abs": 1, "rel": 1, "vel": 1, "min": 0, "max": 0}
        if not rest or rest[0] not in kinds:
            raise Reject("BADCOMMAND")
        kind, numbers = rest[0], rest[1:]
        most = kinds[kind] + (1 if self._seven and kind != "vel" else 0)  # F: move abs P SPEED on firmware 7
        if not kinds[kind] <= len(numbers) <= most:
            raise Reject("BADDATA")
        numbers = [self._whole(each) for each in numbers]
        self._may_move(axes)
        targets = []
        for axis in axes:
            index = self._axes.index(axis)
            lower, upper = self.lasting["limit.min"][index], self.lasting["limit.max"][index]
            target = {"abs": lambda: numbers[0], "rel": lambda: round(axis.pos) + numbers[0], "vel": lambda: None,
                      "min": lambda: lower, "max": lambda: upper}[kind]()
            if target is not None and not lower <= target <= upper:
                raise Reject("BADDATA")  # F: out of range
            if kind == "vel":
                target = upper if numbers[0] > 0 else lower
            targets.append(target)
        for axis, target in zip(axes, targets):
            self._begin(axis, "move")
            if kind == "vel":
                axis.motor.speed = abs(numbers[0]) / FACTOR
            elif len(numbers) > kinds[kind]:
                axis.motor.speed = max(numbers[-1], 1) / FACTOR
            if kind == "vel" and not numbers[0]:
                axis.motor.turn(0.0)
            else:
                axis.motor.go(target + axis.offset)
            self.tell(now, "move", [self._axes.index(axis) + 1, target])
        return "0"

    def _stop(self, rest, number, axes, now):
        for axis in axes:
            if axis.busy:
                axis.flags.add("NI")  # Z README: the reply to stop carries NI
                axis.motor.turn(0.0)
            axis.doing = ""
        self.tell(now, "stop", number)
        return "0"

    def _stop_at_once(self, rest, number, axes, now):
        for index, axis in enumerate(axes):
            if axis.busy:
                axis.flags.add("NI")
                axis.motor.halt()
                axis.doing = ""
                self._stopped(axis, self._axes.index(axis) + 1, now)
        self.tell(now, "estop", number)
        return "0"

    def _get(self, rest, number, axes, now):
        if len(rest) != 1:
            raise Reject("BADCOMMAND")
        name = rest[0]
        fixed = {
            "version": self.firmware, "deviceid": self.device_id, "system.axiscount": self.axes,
            "system.serial": self.serial, "system.voltage": f"{self.voltage:.1f}", "system.access": 1,
        }
        if self._seven:
            fixed["device.id"] = self.device_id  # F: firmware 7
        each = {
            "pos": lambda axis: round(axis.pos), "driver.temperature": lambda axis: f"{self.temperature:.1f}",
            # F: on firmware 7
            "motion.busy": lambda axis: int(axis.busy), "vel": lambda axis: round(axis.motor.velocity * FACTOR),
            "driver.enabled": lambda axis: int(axis.enabled),
        }
        if name in ("motion.busy", "vel", "driver.enabled") and not self._seven:
            raise Reject("BADCOMMAND")
        if name in fixed or (name in self.SETTINGS and self.SETTINGS[name][0] == "device"):
            if number:
                raise Reject("DEVICEONLY")  # AZM
            return str(fixed.get(name, self.lasting.get(name)))
        if name in each:
            return " ".join(str(each[name](axis)) for axis in axes)  # ML: one value an axis, "12345 23456"
        if name in self.SETTINGS:
            return " ".join(str(self.lasting[name][self._axes.index(axis)]) for axis in axes)
        raise Reject("BADCOMMAND")  # ML: get of an unknown setting

    def _set(self, rest, number, axes, now):
        if len(rest) != 2:
            raise Reject("BADCOMMAND" if len(rest) < 2 else "BADDATA")
        name, text = rest
        if name == "pos":
            value = self._whole(text)
            if any(axis.busy for axis in axes):
                raise Reject("STATUSBUSY")  # AZM
            for axis in axes:
                axis.offset = axis.motor.position - value
                axis.flags -= {"WR"}  # no source for what becomes of WR and WH here
            return "0"
        if name not in self.SETTINGS:
            raise Reject("BADCOMMAND")
        scope, _, least, greatest = self.SETTINGS[name]
        value = self._whole(text)
        if not least <= value <= greatest:
            raise Reject("BADDATA")
        if scope == "device" and number:
            raise Reject("DEVICEONLY")
        lasting = dict(self.lasting)
        if scope == "device":
            lasting[name] = value
        else:
            lasting[name] = [value if axis in axes else old for axis, old in zip(self._axes, lasting[name])]
        self.put(now, lasting=lasting)  # F: comm.checksum, comm.alert and maxspeed are lasting settings
        return "0"

    def _warnings(self, rest, number, axes, now):
        if rest not in ([], ["clear"]):
            raise Reject("BADCOMMAND")
        present = sorted(set().union(*(self._flags(axis) for axis in axes)), key=FLAGS.index)
        if rest:
            for axis in axes:
                axis.flags &= {"WR", "WH", "NC"}  # F: WR and WH stay until homed; FS and others are latched
        return " ".join([f"{len(present):02d}"] + present)  # F: NN F1 F2 ...

    def _renumber(self, rest, number, axes, now):
        if number:
            raise Reject("DEVICEONLY")
        value = self._whole(rest[0]) if rest else 1
        if not 1 <= value <= 99:
            raise Reject("BADDATA")
        self.put(now, lasting={**self.lasting, "comm.address": value})
        return "0"  # no source: the reply comes from the new address

    def _system(self, rest, number, axes, now):
        if rest == ["reset"]:
            if number:
                raise Reject("DEVICEONLY")
            self.put(now, resets=self.resets + 1)
            for axis in self._axes:
                axis.motor.halt()
                axis.doing = ""
            self.start(now)  # no source: that the reply goes out first; here it does, with the flags after the reset
            return "0"
        if rest == ["restore"]:
            self.put(now, lasting=self._factory())
            return "0"
        raise Reject("BADCOMMAND")

    def _tools(self, rest, number, axes, now):
        if rest[:1] == ["echo"]:
            return " ".join(rest[1:]) or "0"  # Z checksum.rs: "01 tools echo"; no source for the reply to a bare one
        if rest in (["parking", "park"], ["parking", "unpark"]):
            if any(axis.busy for axis in axes):
                raise Reject("STATUSBUSY")
            for axis in axes:
                axis.parked = rest[1] == "park"
            self.tell(now, "parked", self.parked)
            return "0"
        raise Reject("BADCOMMAND")

    def _driver(self, rest, number, axes, now):
        if not self._seven or rest not in (["enable"], ["disable"]):
            raise Reject("BADCOMMAND")
        for axis in axes:
            axis.enabled = rest == ["enable"]
            if not axis.enabled:
                axis.motor.halt()
                axis.doing = ""
        self.tell(now, "enabled", self.enabled)
        return "0"


DOUBLE = Zaber
