"""A power supply with a heater at its terminals, asked by SCPI: on a stream, in datagrams, by VXI-11 or by HiSLIP.

No maker's: what is here is what the standards leave to none. Sources, named by their letters at the lines below:
  SCPI  SCPI-99 volume 2 (commands, 21.8 errors) and 4 (7: DC power supplies)
  4882  IEEE 488.2: 6.1.11 input buffer, 8 responses, 10 common commands, 11 status
SPDX-License-Identifier: Apache-2.0
"""

import math

from double import ByteDouble, Refused
from scpi import ScpiError, TEXTS, Tree

QUEUE = 10  # SCPI 21.8.1: at least two
BUFFER = 256  # bytes of one message, for a strict one; no source: an instrument has what it has
NAN = "9.91E+37"  # SCPI volume 1, 7.2.1.5: not a number


class ScpiSupply(ByteDouble):
    """The supply and the heater: C T' = P - (T - T_room) / R."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "wire": "stream",  # or udp: a datagram is a message, with a line feed or without, and an answer is a datagram
        "identity": "VITREO DOUBLES,SUPPLY 30-5,0,1.0",  # 4882 10.14: maker, model, serial number, firmware
        "terminator": "lf",  # or crlf
        "volts": 30.0,
        "amperes": 5.0,
        "measuring": 0.02,  # s of a measurement
        "slew": 100.0,  # V/s
        "lose": 0,  # udp: each so manieth answer does not arrive; 0: all do
        "twice": 0,  # udp: each so manieth answer arrives twice
        "chatty": False,  # what was sent comes back ahead of the answer
        "header": False,  # 4882 8.2: the answer repeats the header, as older instruments do
    }
    STATE = ("voltage_set", "current_set", "output", "voltage", "current", "temperature", "load_ohm", "broken_sensor",
             "errors", "answers", "lost")

    def __init__(self, **options):
        self.load_ohm, self.temperature, self.broken_sensor = 10.0, 22.0, False
        self.room, self.heat_capacity, self.resistance = 22.0, 100.0, 2.0  # degC, J/K, K/W
        self.answers = self.lost = 0
        super().__init__(**options)

    def start(self, now):
        """Power-up: 4882 11.5.1.1: bit 7."""
        self._line = bytearray()
        self._event, self._enable, self._service = 0x80, 0, 0
        self.put(now, errors=[])
        self._reset(now)
        self._tree = self._commands()
        self.now = now

    def _reset(self, now):
        """SCPI volume 4, 7: off, no voltage."""
        self.put(now, voltage_set=0.0, current_set=0.1, output=False, voltage=0.0)

    @property
    def current(self):
        """A."""
        return self.voltage / self.load_ohm

    def arranged(self, now):
        """A load that cannot be is refused."""
        if self.load_ohm <= 0:
            self.load_ohm = 10.0
            raise Refused("load_ohm has to be above 0")

    # -- time ----------------------------------------------------------------------------------------------

    def advance(self, now):
        """The voltage slews, the heater warms."""
        while self.now < now - 1e-12:
            aim = min(self.voltage_set, self.current_set * self.load_ohm) if self.output else 0.0
            left = aim - self.voltage
            slewing = abs(left) > 1e-9
            span = min(now - self.now, abs(left) / self.slew if slewing else math.inf, 0.01 if slewing else math.inf)
            middle = self.voltage + math.copysign(self.slew * span / 2, left) if slewing else self.voltage
            if slewing:
                self.voltage = aim if abs(left) <= self.slew * span * (1 + 1e-9) else self.voltage + math.copysign(
                    self.slew * span, left)
            end = self.room + middle**2 / self.load_ohm * self.resistance
            self.temperature = end + (self.temperature - end) * math.exp(-span / (self.heat_capacity * self.resistance))
            super().advance(self.now + span)
        super().advance(now)

    # -- the line ------------------------------------------------------------------------------------------

    def receive(self, data, now):
        """A datagram ends a message."""
        super().receive(data, now)
        if self.wire == "udp" and self._line:
            self.take(0x0A, now)

    def take(self, byte, now):
        """4882 7.5.1: a message ends with a line feed."""
        if byte != 0x0A:
            self._line.append(byte)
            return
        line = self._line.decode("latin-1").strip()
        self._line.clear()
        if line:
            self.message(line, now)

    def message(self, line, now):
        """Carries out one program message and sends its response."""
        self.tell(now, "line", line)
        replies, duration = [], 0.0
        if self.strict and len(line) > BUFFER:
            self._error(-363, now)  # SCPI 21.8.11: input buffer overrun: nothing of it is carried out
            return
        try:
            for handler, argument, query in self._tree.units(line):
                told = handler(argument, now)
                if query:
                    replies.append(self._headed(line, told))
                    duration += self.measuring if "MEAS" in line.upper() else 0.0
        except ScpiError as error:
            self._error(error.code, now)
        if replies:
            self._respond(";".join(replies), line, now, duration)

    def _headed(self, line, told):
        return f"{line.split('?')[0].strip()} {told}" if self.header and "*" not in line else told

    def _respond(self, text, line, now, duration):
        self.answers += 1
        end = {"lf": "\n", "crlf": "\r\n"}[self.terminator]
        if self.chatty:
            self.answer((line + end).encode("latin-1"), now)
        if self.lose and self.wire == "udp" and self.answers % self.lose == 0:
            self.put(now, lost=self.lost + 1)
            return
        for _ in range(2 if self.twice and self.wire == "udp" and self.answers % self.twice == 0 else 1):
            self.answer((text + end).encode("latin-1"), now, duration)

    def clear_input(self, now):
        """4882 5.8: device clear: what has come and what waits is gone."""
        self._line.clear()
        self._out.clear()

    def interrupted(self, now):
        """4882 6.3.2.3: query INTERRUPTED."""
        self._out.clear()
        self._error(-410, now)

    def trigger(self, now):
        """4882 6.1.4.2.5: nothing is armed here."""
        self._error(-211, now)

    def status_byte(self, now):
        """4882 11.2: MAV, ESB; SCPI: bit 2: the error queue."""
        bits = (4 if self.errors else 0) | (16 if self._out else 0) | (32 if self._event & self._enable else 0)
        return bits | (64 if bits & self._service else 0)

    def _error(self, code, now):
        self._event |= 0x20 if -200 < code <= -100 else 0x10 if -300 < code <= -200 else 0x04  # 4882 11.5.1
        if len(self.errors) < QUEUE:
            self.put(now, errors=self.errors + [code])
        else:
            self.put(now, errors=self.errors[:-1] + [-350])  # SCPI 21.8.1: queue overflow

    # -- commands ------------------------------------------------------------------------------------------

    def _commands(self):
        level = "[:LEVel][:IMMediate][:AMPLitude]"
        return Tree({
            "*IDN?": lambda a, now: self.identity, "*RST": lambda a, now: self._reset(now), "*CLS": self._clear,
            "*OPC?": lambda a, now: "1", "*OPC": self._complete, "*WAI": lambda a, now: None, "*TST?": lambda a, now: "0",
            "*ESR?": self._take_event, "*ESE": self._set_enable, "*ESE?": lambda a, now: str(self._enable),
            "*SRE": self._set_service, "*SRE?": lambda a, now: str(self._service),
            "*STB?": lambda a, now: str(self.status_byte(now)),
            "[SOURce:]VOLTage" + level: self._set_voltage, f"[SOURce:]VOLTage{level}?": lambda a, now: f"{self.voltage_set:.4E}",
            "[SOURce:]CURRent" + level: self._set_current, f"[SOURce:]CURRent{level}?": lambda a, now: f"{self.current_set:.4E}",
            "OUTPut[:STATe]": self._set_output, "OUTPut[:STATe]?": lambda a, now: str(int(self.output)),
            "MEASure[:SCALar]:VOLTage[:DC]?": lambda a, now: f"{self.voltage:+.5E}",
            "MEASure[:SCALar]:CURRent[:DC]?": lambda a, now: f"{self.current:+.5E}",
            "MEASure[:SCALar]:TEMPerature?": lambda a, now: NAN if self.broken_sensor else f"{self.temperature:+.5E}",
            "SYSTem:ERRor[:NEXT]?": self._next_error, "SYSTem:VERSion?": lambda a, now: "1999.0",
        })

    def _value(self, argument, most):
        """4882 7.7.2: a decimal number; SCPI volume 1, 7.2.1: MINimum, MAXimum; suffixes of volts and amperes."""
        text = (argument or "").upper().strip()
        if not text:
            raise ScpiError(-109)
        if text in ("MIN", "MINIMUM", "MAX", "MAXIMUM"):
            return most if text.startswith("MAX") else 0.0
        scale = 1.0
        for unit, factor in (("MV", 1e-3), ("MA", 1e-3), ("V", 1.0), ("A", 1.0)):
            if text.endswith(unit):
                text, scale = text[:-len(unit)].strip(), factor
                break
        try:
            value = float(text) * scale
        except ValueError:
            raise ScpiError(-120) from None
        if not 0 <= value <= most:
            raise ScpiError(-222)
        return value

    def _set_voltage(self, argument, now):
        self.put(now, voltage_set=self._value(argument, self.volts))

    def _set_current(self, argument, now):
        self.put(now, current_set=self._value(argument, self.amperes))

    def _set_output(self, argument, now):
        word = (argument or "").upper()
        if word not in ("ON", "OFF", "0", "1"):
            raise ScpiError(-141 if word else -109)
        self.put(now, output=word in ("ON", "1"))

    def _bits(self, argument):
        try:
            value = int(float(argument or ""))
        except ValueError:
            raise ScpiError(-120) from None
        if not 0 <= value <= 255:
            raise ScpiError(-222)
        return value

    def _set_enable(self, argument, now):
        self._enable = self._bits(argument)

    def _set_service(self, argument, now):
        self._service = self._bits(argument) & ~64

    def _take_event(self, argument, now):
        told, self._event = self._event, 0
        return str(told)

    def _complete(self, argument, now):
        self._event |= 1

    def _clear(self, argument, now):
        self._event = 0
        self.put(now, errors=[])

    def _next_error(self, argument, now):
        code = self.errors[0] if self.errors else 0
        self.put(now, errors=self.errors[1:])
        return f'{code},"{TEXTS.get(code, "Error")}"'


DOUBLE = ScpiSupply
