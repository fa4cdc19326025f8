"""A Thorlabs K-Cube KDC101 with a DC servo stage, by the APT binary protocol.

Sources, named by their letters at the lines below:
  APT  Thorlabs' APT Communications Protocol as quoted in the doc strings of github UniNE-CHYN/thorpy
       thorpy/message/motorcontrol.py and of a public Rust driver of the KDC101 (issue 39, page 126)
  YAQ  github yaq-project/thorlabs-apt-protocol functions.py, parsing.py, README.md (the examples in bytes)
  PLL  github AlexShkarin/pyLabLib pylablib/devices/Thorlabs/kinesis.py
  THP  github UniNE-CHYN/thorpy, its controller and its simulator
  F    the project's fact sheet scripted_instruments, B 1
SPDX-License-Identifier: Apache-2.0
"""

import math
import struct

from double import ByteDouble, Refused
from motion import Motor

HOST, UNIT = 0x01, 0x50  # YAQ README: source 1, dest 0x50
SAMPLE = 2048 / 6e6  # s; PLL _calculate_scale for the KDC101
# Stage: (its number in 0x0006, counts per mm or degree, travel in mm or degrees). PLL _autodetect_stage, _get_step_scale;
# no source for the travels but the stages' names.
STAGES = {
    "MTS25-Z8": (7, 34304.0, 25.0), "MTS50-Z8": (8, 34304.0, 50.0), "Z825": (9, 34304.0, 25.0),
    "Z812": (10, 34304.0, 12.0), "PRM1-Z8": (6, 1919.6418578623391, math.inf),
}
FORWARD_LIMIT, REVERSE_LIMIT, FORWARD_SOFT, REVERSE_SOFT = 1 << 0, 1 << 1, 1 << 2, 1 << 3  # YAQ _parse_status_bits
MOVING_FORWARD, MOVING_REVERSE, JOGGING_FORWARD, JOGGING_REVERSE = 1 << 4, 1 << 5, 1 << 6, 1 << 7
CONNECTED, HOMING, HOMED, MOTION_ERROR = 1 << 8, 1 << 9, 1 << 10, 1 << 14
ENABLED = 1 << 31
UNANSWERED = 50  # APT: it stops after some 50 status messages without a "server alive"
PERIOD = 0.1  # s between two automatic updates: APT, 10 Hz


class ThorlabsApt(ByteDouble):
    """The controller, the motor and its two switches."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "stage": "MTS25-Z8",
        "serial": 27250001,  # F: numbers of the KDC101 begin with 27
        "model": "KDC101",
        "firmware": "1.2.3",  # no source for a number that exists
        "alive": True,  # APT says that updates end without 0x0492; THP "has not been observed": False
        "swapped": False,  # PLL has bit 0, 4 and 6 as backward, YAQ as forward
        "at_limit": "stopped",  # no source: what is said at a switch: stopped, completed, or nothing
        "idle_stop": True,  # no source: whether a stop at rest is answered
        "chatty": False,  # an unasked status update and a 0x0080 before each answer
    }
    STATE = (
        "rail", "position", "velocity", "status", "enabled", "homed", "updating", "silenced", "ignored", "completed",
        "slipping", "vel_params", "jog_params", "home_params", "limit_params", "backlash", "serial_says",
    )

    def __init__(self, **options):
        self.slipping = False  # something holds the carriage: it does not follow
        self._rail = None
        self.ignored = self.completed = 0
        super().__init__(**options)

    @property
    def _counts(self):
        return STAGES[self.stage][1]

    @property
    def _travel(self):
        return STAGES[self.stage][2] * self._counts

    def start(self, now):
        """Power-up: the counter is zero wherever the carriage is, until it is homed (APT, 0x0410)."""
        if self.stage not in STAGES:
            raise Refused(f"no stage '{self.stage}'; there are {', '.join(STAGES)}")
        if self._rail is None:
            middle = 0.4 * self._travel if math.isfinite(self._travel) else 12345.0
            self._rail = Motor(middle, 1.0, 1.0)
        self._rail.halt()
        self._rail.now = now
        self._offset = self._rail.position
        self._buffer = bytearray()
        self._doing, self._limit, self._since, self._next_update = "", 0, 0, None
        self._end_messages = True
        counts = self._counts
        # no source for the values after power-up
        fast, quick = round(2.3 * counts * SAMPLE * 65536), round(1.5 * counts * SAMPLE**2 * 65536)
        self.put(now, enabled=True, homed=False, updating=False, silenced=False, serial_says=self.serial,
                 vel_params=[0, quick, fast], jog_params=[2, round(0.1 * counts), 0, quick, fast, 2],
                 home_params=[2, 1, round(1.0 * counts * SAMPLE * 65536), 0],  # PLL: reverse 2, reverse switch 1
                 limit_params=[1, 1, 0, 0, 1], backlash=0)  # PLL: 1 ignores
        self.now = now

    # Told to a test.
    position = property(lambda self: round(self._rail.position - self._offset))
    velocity = property(lambda self: self._rail.velocity)

    @property
    def rail(self):
        """Where the carriage is on its rail, in counts from the reverse switch."""
        return self._rail.position

    @property
    def status(self):
        """The 32 status bits of YAQ."""
        bits = self._limit | (ENABLED if self.enabled else 0) | (HOMED if self.homed else 0) | CONNECTED
        if self._doing == "home":
            bits |= HOMING
        if self._rail.busy:
            forward = self._rail.velocity > 0 or (self._rail.velocity == 0 and (self._rail.target or 0) > self.rail)
            jog = self._doing == "jog"
            bits |= (JOGGING_FORWARD if jog else MOVING_FORWARD) if forward else (
                JOGGING_REVERSE if jog else MOVING_REVERSE)
        if self.slipping and self._doing:
            bits |= MOTION_ERROR
        if self.swapped:
            for low in (0, 2, 4, 6):
                pair = bits >> low & 3
                bits = bits & ~(3 << low) | ((pair & 1) << 1 | pair >> 1) << low
        return bits

    # -- time ----------------------------------------------------------------------------------------------

    def next_event(self):
        """Ends of movements are looked for every 5 ms; updates have their own time."""
        times = [self._next_update] if self._next_update is not None else []
        if self._rail.busy:
            times.append(self.now + 0.005)
        return min(times, default=None)

    def advance(self, now):
        """Moves on, and sends the updates that are due."""
        while self.now < now:
            event = self.next_event()
            until = now if event is None else min(now, max(event, self.now))
            self._run(until)
            super().advance(until)
            if self._next_update is not None and self._next_update <= until:
                self._update(self._next_update)
                self._updates += 1
                self._next_update = self._began + self._updates * PERIOD
            if until == now:
                break
        super().advance(now)

    def _bounds(self):
        least, most = (0.0, self._travel) if math.isfinite(self._travel) else (-math.inf, math.inf)
        if self.limit_params[4] in (2, 3) and self._doing != "home":  # PLL: 2 stops at once, 3 with its profile
            least = max(least, self.limit_params[3] + self._offset)
            most = min(most, self.limit_params[2] + self._offset)
        return least, most

    def _run(self, until):
        was = self._rail.busy
        if self.slipping:
            self._rail.now = until
            return
        least, most = self._bounds()
        at_end = self._rail.run(until, min(least, self.rail), max(most, self.rail))
        if at_end and self._doing != "home":
            forward = self.rail >= most
            hard = self.rail >= self._travel or self.rail <= 0
            self._limit = (FORWARD_LIMIT if forward else REVERSE_LIMIT) if hard else (
                FORWARD_SOFT if forward else REVERSE_SOFT)
            self._ended(until, self.at_limit)
        elif was and not self._rail.busy:
            self._ended(until, "stopped" if self._doing == "stop" else "completed")

    def _ended(self, now, how):
        doing, self._doing = self._doing, ""
        if doing == "home":
            # PLL: home_direction, limit_switch, velocity, offset: the zero is the offset away from the switch
            self._offset = self._rail.position - self.home_params[3]
            self.put(now, homed=True)
            self.tell(now, "homed", self.position)
            self._short(0x0444, 1, 0, now)  # F, YAQ mot_move_homed
            return
        self.put(now, completed=self.completed + 1)
        self.tell(now, how, self.position)
        if self._end_messages and how in ("completed", "stopped"):
            # YAQ: 0x0464 and 0x0466 carry 14 bytes of status
            self._status_message(0x0464 if how == "completed" else 0x0466, now)

    # -- the line ------------------------------------------------------------------------------------------

    def take(self, byte, now):
        """One byte: a header of six, then its data when bit 7 of the destination is set (APT, PLL send_comm_data)."""
        self._buffer.append(byte)
        if len(self._buffer) < 6:
            return
        number, length, target, source = struct.unpack_from("<HHBB", self._buffer)
        whole = 6 + (length if target & 0x80 else 0)
        if len(self._buffer) < whole:
            return
        data = bytes(self._buffer[6:whole])
        param1, param2 = self._buffer[2], self._buffer[3]
        self._buffer.clear()
        if target & 0x7F != UNIT or source != HOST:
            self.put(now, ignored=self.ignored + 1)  # no source: a message for another unit is passed over
            return
        self.tell(now, "message", f"{number:04x} {data.hex(' ') if target & 0x80 else f'{param1:02x} {param2:02x}'}")
        self._since = 0 if number == 0x0492 else self._since
        if not self._command(number, param1, param2, data if target & 0x80 else None, now):
            self.put(now, ignored=self.ignored + 1)  # F: unknown messages are met with silence ?

    def _short(self, number, param1, param2, now):
        self._unasked(now)
        self.answer(struct.pack("<HBBBB", number, param1, param2, HOST, UNIT), now)

    def _long(self, number, data, now):
        self._unasked(now)
        self.answer(struct.pack("<HHBB", number, len(data), HOST | 0x80, UNIT) + data, now)

    def _unasked(self, now):
        if self.chatty:
            self.answer(struct.pack("<HHBB", 0x0491, 14, HOST | 0x80, UNIT) + self._status_data(), now)
            self.answer(struct.pack("<HBBBB", 0x0080, 0, 0, HOST, UNIT), now)  # YAQ hw_response: no parameters

    def _status_data(self):
        # YAQ _parse_dcstatus: channel, position, velocity as a signed short, a word that is not used, status bits.
        # no source for the unit of the velocity: counts in one sample time times 65536 does not fit; here counts/ms
        velocity = max(-32768, min(32767, round(self.velocity / 1000)))
        return struct.pack("<HihHI", 1, self.position, velocity, 0, self.status)

    def _status_message(self, number, now):
        self._long(number, self._status_data(), now)

    def _update(self, now):
        """APT: status updates end after some 50 without a sign of life, and go on with the next one."""
        if self.alive and self._since >= UNANSWERED:
            self.put(now, silenced=True)
            return
        self.put(now, silenced=False)
        self._since += 1
        self.answer(struct.pack("<HHBB", 0x0491, 14, HOST | 0x80, UNIT) + self._status_data(), now)

    # -- messages ------------------------------------------------------------------------------------------

    # YAQ functions.py, F: the length of the data of each message that has some
    LENGTHS = {0x0410: 6, 0x0413: 14, 0x0416: 22, 0x0423: 16, 0x043A: 6, 0x0440: 14, 0x0448: 6, 0x0453: 6}

    def _command(self, number, param1, param2, data, now):
        """Carries out one message; False where it is not known or not of its length."""
        if data is not None:
            fits = len(data) == self.LENGTHS.get(number) if self.strict else len(data) >= self.LENGTHS.get(number, 1 << 16)
            if not fits or struct.unpack_from("<H", data)[0] != 1:
                return False  # no source: a message of another length is passed over; less strict: only a shorter one
        act = (self._with_data if data is not None else self._without_data)(number, param1, param2, data, now)
        return act is not False

    def _without_data(self, number, param1, param2, data, now):
        if number == 0x0005:
            self._info(now)
        elif number == 0x0011:
            self.put(now, updating=True)
            self._began, self._updates, self._next_update, self._since = now, 1, now + PERIOD, 0
        elif number == 0x0012:
            self.put(now, updating=False)
            self._next_update = None
        elif number in (0x0002, 0x0018, 0x0223, 0x0492):
            pass  # YAQ: hw_disconnect, hw_no_flash_programming, mod_identify (blinks), ack
        elif number == 0x046B:
            self._end_messages = False  # YAQ mot_suspend_endofmovemsges
        elif number == 0x046C:
            self._end_messages = True
        elif param1 != 1:
            return False
        elif number in (0x0414, 0x0417, 0x0424, 0x043B, 0x0441):
            self._tell_parameters(number, now)
        else:
            return self._channel(number, param2, now)
        return None

    def _channel(self, number, param2, now):
        """Messages of a channel without data."""
        if number == 0x0210 and param2 in (1, 2):  # F: 1 on, 2 off
            self._enable(param2 == 1, now)
        elif number == 0x0211:
            self._short(0x0212, 1, 1 if self.enabled else 2, now)  # YAQ: enabled is 1
        elif number == 0x0411:
            self._long(0x0412, struct.pack("<Hi", 1, self.position), now)
        elif number == 0x0429:
            self._long(0x042A, struct.pack("<HI", 1, self.status), now)  # F: status in the last four bytes
        elif number == 0x0490:
            self._status_message(0x0491, now)
        elif number == 0x0443:
            self._home(now)
        elif number in (0x0448, 0x0453):
            return False  # their short forms want parameters that were set before; not there
        elif number == 0x0457 and param2 in (1, 2):  # YAQ mot_move_velocity; PLL jog: direction 1 forward, 2 reverse
            self._drive(lambda: self._rail.turn(self._speed() * (1 if param2 == 1 else -1)), "move", now)
        elif number == 0x046A and param2 in (1, 2):
            self._jog(1 if param2 == 1 else -1, now)
        elif number == 0x0465 and param2 in (1, 2):
            self._stop(param2 == 1, now)
        else:
            return False
        return None

    def _with_data(self, number, param1, param2, data, now):
        fields = {0x0410: "<i", 0x0413: "<3i", 0x0416: "<H4iH", 0x0423: "<2H2iH", 0x043A: "<i", 0x0440: "<2H2i",
                  0x0448: "<i", 0x0453: "<i"}[number]  # YAQ functions.py, without the channel
        values = list(struct.unpack_from(fields, data, 2))
        names = {0x0413: "vel_params", 0x0416: "jog_params", 0x0423: "limit_params", 0x0440: "home_params"}
        if number in names:
            self.put(now, **{names[number]: values})
        elif number == 0x043A:
            self.put(now, backlash=values[0])
        elif number == 0x0410:
            self._offset = self._rail.position - values[0]  # APT: sets the live position counter
            self.tell(now, "counter", values[0])
        elif number == 0x0448:
            self._go(self.position + values[0], now)
        else:
            self._go(values[0], now)

    def _tell_parameters(self, number, now):
        names = {0x0414: ("<3i", self.vel_params), 0x0417: ("<H4iH", self.jog_params),
                 0x0424: ("<2H2iH", self.limit_params), 0x043B: ("<i", [self.backlash]), 0x0441: ("<2H2i", self.home_params)}
        form, values = names[number]
        self._long(number + 1, struct.pack("<H" + form[1:], 1, *values), now)

    def _info(self, now):
        """84 bytes: YAQ hw_get_info: serial, model, type, firmware, notes, stage, hardware, state, channels; F: stage at 76."""
        major, minor, interim = (int(each) for each in self.firmware.split("."))
        notes = b"K-Cube DC servo".ljust(46, b"\0")
        head = struct.pack("<I8sH4B", self.serial, self.model.encode().ljust(8, b"\0"), 16, interim, minor, major, 0)
        body = head + notes
        body += bytes(76 - len(body)) + struct.pack("<HHHH", STAGES[self.stage][0], 1, 0, 1)
        self._long(0x0006, body, now)

    def _enable(self, on, now):
        self.put(now, enabled=on)
        if not on and self._rail.busy:
            self._rail.halt()  # no source: a channel without power does not go on
            self._doing = ""

    def _speed(self, counts=None):
        return max(1.0, (self.vel_params[2] if counts is None else counts) / (SAMPLE * 65536))

    def _drive(self, begin, doing, now):
        if not self.enabled:
            self.tell(now, "not enabled", doing)  # no source for an answer: none
            return
        self._rail.speed = self._speed(self.home_params[2] if doing == "home" else None)
        self._rail.accel = max(1.0, self.vel_params[1] / (SAMPLE**2 * 65536))
        self._limit, self._doing = 0, doing
        begin()
        self.tell(now, doing, self._rail.target if self._rail.target is None else round(self._rail.target - self._offset))
        if not self._rail.busy:
            self._ended(now, "completed")

    def _go(self, target, now):
        self._drive(lambda: self._rail.go(target + self._offset), "move", now)
        if self.enabled and self._doing and self._rail.target == self._rail.position:
            self._rail.halt()
            self._ended(now, "completed")

    def _jog(self, sign, now):
        mode, step = self.jog_params[0], self.jog_params[1]
        if mode == 2:  # PLL _p_jog_mode: 1 continuous, 2 step
            self._drive(lambda: self._rail.go(self._rail.position + sign * step), "jog", now)
        else:
            self._drive(lambda: self._rail.turn(sign * self._speed(self.jog_params[4])), "jog", now)

    def _home(self, now):
        self.put(now, homed=False)
        self._drive(lambda: self._rail.go(0.0), "home", now)

    def _stop(self, at_once, now):
        if not self._rail.busy:
            if self.idle_stop:
                self._status_message(0x0466, now)
            return
        self._doing = "stop"
        if at_once:  # F, PLL: 1 immediate, 2 profiled
            self._rail.halt()
            self._ended(now, "stopped")
        else:
            self._rail.turn(0.0)


DOUBLE = ThorlabsApt
