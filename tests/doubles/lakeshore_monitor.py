"""Lake Shore thermometers: the monitor 218 and the controller 336.

Sources, named by their letters at the lines below:
  M218  Lake Shore Model 218 user's manual, pages 6-10 (message flow), 6-16, 6-22 (CRDG?), 6-26, 6-27 (status bits)
  IRTF  irtfweb.ifa.hawaii.edu: a laboratory's notes with answers of a real 218: 9600 7O1, CR LF, KRDG? of all eight
  M331  Model 331 user's manual, pages 6-28, 6-32, 6-37, 6-38 (CRDG?, HTR?, RANGE, RDGST?, SETP); M335: *IDN? of a 335
  no source at hand for the 336 itself but these of its family: outputs by number, its inputs A to D, 7777 by Ethernet
SPDX-License-Identifier: Apache-2.0
"""

import math

from double import ByteDouble, Refused

IDENTITIES = {"218": "LSCI,MODEL218E,21EA4F,042109",  # IRTF
              "336": "LSCI,MODEL336,1234567/1234567,1.0"}  # M335's form
INPUTS = {"218": "12345678", "336": "ABCD"}
INVALID, UNDER, OVER = 1, 16, 32  # M331 6-37
COLDEST, HOTTEST = 1.4, 480.0  # K; IRTF: an open input reads +480.00; no source for the other end
WATTS = {0: 0.0, 1: 0.5, 2: 5.0, 3: 50.0}  # M331 RANGE: off, low, medium, high


class LakeshoreMonitor(ByteDouble):
    """The instrument, its sensors, and for a 336 a heater at input A."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "model": "218",
        "identity": "",
        "terminator": "crlf",  # or lf
        "pause": 0.05,  # s: M218 6-10: no communication for 50 ms after an answer; what comes then is lost
        "chatty": False,  # an empty line ahead of each answer
    }
    STATE = ("kelvin", "open_inputs", "setpoint", "range", "ramp", "output", "lost", "unknown", "aim")

    def __init__(self, **options):
        self.kelvin, self.open_inputs, self.lost, self.unknown = [295.0] * 8, [], 0, 0
        self.room, self.tau, self.kelvin_per_watt = 295.0, 120.0, 4.0
        super().__init__(**options)

    def start(self, now):
        """Power-up: M331: the heater is off."""
        if self.model not in IDENTITIES:
            raise Refused(f"no model '{self.model}'; there are {', '.join(IDENTITIES)}")
        self._line, self._quiet_from = bytearray(), -1.0
        self.put(now, setpoint=0.0, range=0, ramp=[0, 0.0], output=0.0, aim=0.0)
        self.now = now

    # -- time ----------------------------------------------------------------------------------------------

    def advance(self, now):
        """The heater follows the set-point, which a ramp may hold back."""
        while self.model == "336" and self.now < now - 1e-9:
            span = min(1.0, now - self.now)
            if self.ramp[0] and self.ramp[1]:
                step = self.ramp[1] / 60 * span  # K/min
                self.aim += max(-step, min(step, self.setpoint - self.aim))
            else:
                self.aim = self.setpoint
            most = WATTS[self.range]
            needed = (self.aim - self.room) / self.kelvin_per_watt + (self.aim - self.kelvin[0]) * 0.5
            watts = min(most, max(0.0, needed))
            self.output = 100 * watts / most if most else 0.0
            end = self.room + watts * self.kelvin_per_watt
            self.kelvin[0] = end + (self.kelvin[0] - end) * math.exp(-span / self.tau)
            super().advance(self.now + span)
        super().advance(now)

    # -- the line ------------------------------------------------------------------------------------------

    def take(self, byte, now):
        """M218: CR LF; either ends a line here."""
        if byte not in (0x0D, 0x0A):
            self._line.append(byte)
            return
        line = self._line.decode("latin-1").strip()
        self._line.clear()
        if not line:
            return
        self.tell(now, "line", line)
        if self.strict and self.model == "218" and now < self._quiet_from + self.pause - 1e-9:
            self.put(now, lost=self.lost + 1)
            return
        told = [each for each in (self._unit(unit.strip(), now) for unit in line.split(";")) if each is not None]
        self._quiet_from = now + self.late
        if told:
            end = {"crlf": "\r\n", "lf": "\n"}[self.terminator]
            self.answer(((end if self.chatty else "") + ";".join(told) + end).encode("latin-1"), now)

    def _unit(self, unit, now):
        name, _, argument = unit.partition(" ")
        act = self._commands().get(name.upper())
        if act is None:
            self.put(now, unknown=self.unknown + 1)  # no source: silence
            return None
        return act(argument.strip(), now)

    def _commands(self):
        common = {"*IDN?": lambda a, now: self.identity or IDENTITIES[self.model],
                  "KRDG?": lambda a, now: self._reading(a, 0.0), "CRDG?": lambda a, now: self._reading(a, 273.15),
                  "RDGST?": self._status, "*RST": lambda a, now: self.start(now), "*OPC?": lambda a, now: "1"}
        if self.model == "336":
            common.update({"SETP": self._set_setpoint, "SETP?": lambda a, now: self._format(self.setpoint),
                           "RANGE": self._set_range, "RANGE?": lambda a, now: str(self.range),
                           "HTR?": lambda a, now: f"{self.output:+06.1f}",  # M331: +nnn.n
                           "RAMP": self._set_ramp, "RAMP?": lambda a, now: f"{self.ramp[0]},{self.ramp[1]:+.1f}",
                           "RAMPST?": lambda a, now: str(int(abs(self.aim - self.setpoint) > 1e-6))})
        return common

    @staticmethod
    def _format(value):
        """IRTF: +480.00, +01.000: a sign, five digits and a point."""
        return f"{value:+07.2f}" if abs(value) >= 100 else f"{value:+07.3f}"

    def _value(self, index):
        if index in self.open_inputs:
            return HOTTEST
        return min(max(self.kelvin[index], COLDEST), HOTTEST)

    def _indices(self, argument):
        """M218: 0, and no input, are all of them."""
        names = INPUTS[self.model]
        if argument in ("", "0"):
            return list(range(len(names)))
        return [names.index(argument.upper())] if len(argument) == 1 and argument.upper() in names else []

    def _reading(self, argument, zero):
        chosen = self._indices(argument)
        return ",".join(self._format(self._value(each) - zero) for each in chosen) or None

    def _status(self, argument, now):
        chosen = self._indices(argument)
        if len(chosen) != 1:
            return None  # no source
        index = chosen[0]
        bits = INVALID | OVER if index in self.open_inputs else 0
        bits |= OVER if self.kelvin[index] > HOTTEST else UNDER if self.kelvin[index] < COLDEST else 0
        return f"{bits:03d}"  # M331: "000" for a valid reading

    def _pair(self, argument):
        """Output 1 and its value."""
        parts = [each.strip() for each in argument.split(",")]
        if len(parts) < 2 or parts[0] != "1":
            return None
        try:
            return [float(each) for each in parts[1:]]
        except ValueError:
            return None

    def _set_setpoint(self, argument, now):
        given = self._pair(argument)
        if given and 0 <= given[0] <= 1000:
            self.aim = self.kelvin[0] if self.ramp[0] else given[0]
            self.put(now, setpoint=given[0])

    def _set_range(self, argument, now):
        given = self._pair(argument)
        if given and given[0] in WATTS:
            self.put(now, range=int(given[0]))

    def _set_ramp(self, argument, now):
        given = self._pair(argument)
        if given and len(given) == 2 and given[0] in (0, 1) and 0 <= given[1] <= 100:
            self.put(now, ramp=[int(given[0]), given[1]])


DOUBLE = LakeshoreMonitor
