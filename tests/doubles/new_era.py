"""A New Era NE-1000 syringe pump, in basic mode and in safe mode.

Sources, named by their letters at the lines below:
  MAN   New Era NE-1000, NE-1600, NE-4000 user's manuals (publications 1200-01, 1200-02, 1240-01; 8/2014), chapters "RS-232
        protocol: basic mode", "safe mode", "command errors and alarms", "command set"
  M500  the NE-500/NE-501 manual (same firmware), 5.4 to 5.7; M9000: the NE-9000's, 12.4.5 (system commands)
  NESP  github florian-lapp/nesp-lib-py nesp_lib/pump.py: what goes to and fro
  F     the project's fact sheet scripted_instruments, B 4
SPDX-License-Identifier: Apache-2.0
"""

import binascii
import math
import re

from double import ByteDouble

STX, ETX, CR = 0x02, 0x03, 0x0D  # MAN
INTER_BYTE = 0.5  # s: MAN: an incomplete packet is dropped
# no source at hand but the maker's data sheet by memory: the rack's slowest and fastest speed, in mm/s
SLOWEST, FASTEST = 0.04205 / 3600, 51.005 / 60
PER_ML = {"MM": 60.0, "MH": 3600.0, "UM": 60000.0, "UH": 3600000.0}  # a rate unit's seconds a ml: MAN, NESP


class Error(Exception):
    """A command error: MAN: empty, NA, OOR, COM, IGN."""


def crc(data):
    """NESP, F: CCITT, polynomial 0x1021, start 0; MAN's example is SAF0 -> 55 43."""
    return binascii.crc_hqx(data, 0)


def four(value):
    """MAN: at most four digits and a point, at most three behind it; NESP wants the point always."""
    behind = 3 if value < 10 else 2 if value < 100 else 1 if value < 1000 else 0
    text = f"{value:.{behind}f}"
    return text if "." in text else text + "."


class NewEra(ByteDouble):
    """The pump, its syringe, and what holds it up."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "address": 0,
        "version": "NE1000V3.928",  # NESP's test, F
        "alarm_at_power_up": True,  # MAN: a system reset alarm
        "chatty": False,  # what is sent comes back ahead of the answer, as from an adapter that echoes
    }
    STATE = ("lasting", "running", "paused", "purging", "alarm", "infused_ml", "withdrawn_ml", "plunger_ml", "rate_ml_s",
             "blocked", "safe_timer_ends")

    def __init__(self, **options):
        self.lasting = None
        self.blocked = False  # something holds the plunger
        self.plunger_ml = 0.0  # what has been pushed out since the beginning
        super().__init__(**options)

    def start(self, now):
        """Power-up: MAN: settings last, also safe mode; the rate while pumping does not."""
        if self.lasting is None:
            self.lasting = {"DIA": 26.59, "VOL": 0.0, "RAT": 1.0, "units": "MH", "volume_units": "ML", "DIR": "INF",
                            "SAF": 0, "address": self.address}
        self._line, self._packet, self._last_byte = bytearray(), None, now
        self._phase_ml = 0.0
        self.put(now, running=False, paused=False, purging=False, infused_ml=0.0, withdrawn_ml=0.0, rate_ml_s=0.0,
                 safe_timer_ends=None, alarm="R" if self.alarm_at_power_up else "")
        self.now = now

    def greet(self, now):
        """MAN: in safe mode an alarm is sent by itself."""
        super().greet(now)
        if self.lasting["SAF"] and self.alarm:
            self._send(self._status(), now)

    # -- time ----------------------------------------------------------------------------------------------

    def _moving(self):
        return self.running or self.purging

    def next_event(self):
        """The end of the volume, or of the host's silence."""
        times = [] if self.safe_timer_ends is None else [self.safe_timer_ends]
        if self.running and self.lasting["VOL"]:
            times.append(self.now + max(0.0, self._left() / self.rate_ml_s))
        if self._moving() and self.blocked:
            times.append(self.now)
        return min(times, default=None)

    def _left(self):
        return self._volume_ml() - self._phase_ml

    def _volume_ml(self):
        return self.lasting["VOL"] * (1.0 if self.lasting["volume_units"] == "ML" else 1e-3)

    def advance(self, now):
        """Pumps on."""
        while (event := self.next_event()) is not None and event <= now:
            self._pump(event)
            if self._moving() and self.blocked:
                self._raise_alarm("S", event)
            elif self.safe_timer_ends is not None and event >= self.safe_timer_ends:
                self.put(event, safe_timer_ends=None)  # MAN: it does not restart until the next valid packet
                self._raise_alarm("T", event)
            elif self.running:
                self._phase_ml = 0.0
                self.put(event, running=False)
                self.tell(event, "dispensed", self._volume_ml())
        self._pump(now)

    def _pump(self, now):
        if self._moving() and now > self.now and not self.blocked:
            moved = self.rate_ml_s * (now - self.now)
            if self.running and self.lasting["VOL"]:
                moved = min(moved, self._left())
                self._phase_ml += moved
                if self._left() < 1e-12:
                    self._phase_ml = self._volume_ml()
            out = self.lasting["DIR"] == "INF"
            self.plunger_ml += moved if out else -moved
            if out:
                self.infused_ml += moved
            else:
                self.withdrawn_ml += moved
        super().advance(now)

    def _raise_alarm(self, letter, now):
        self.put(now, alarm=letter, running=False, purging=False, paused=False)
        if self.lasting["SAF"]:
            self._send(self._status(), now)  # MAN: the auto alarm; it does not clear the alarm

    # -- the line ------------------------------------------------------------------------------------------

    def take(self, byte, now):
        """MAN: basic: up to a carriage return; safe: STX, length, text, CRC, ETX."""
        if self._packet is not None and now > self._last_byte + INTER_BYTE:
            self.tell(now, "dropped", bytes(self._packet))
            self._packet = None
        self._last_byte = now
        if self._packet is not None:
            self._packet.append(byte)
            if len(self._packet) > 1 and len(self._packet) == 1 + self._packet[1]:
                packet, self._packet = bytes(self._packet), None
                self._packet_came(packet, now)
        elif byte == STX:
            # NESP sends SAF as a packet in either mode: a packet is known by its first byte
            self._packet, self._line = bytearray([STX]), bytearray()
        elif byte == CR:
            line, self._line = bytes(self._line), bytearray()
            if self.lasting["SAF"]:
                self.tell(now, "not a packet", line)  # no source for an answer: none
                return
            if self.chatty:
                self.answer(line + b"\r", now)
            self._command(line, now)
        else:
            self._line.append(byte)

    def _packet_came(self, packet, now):
        if self.chatty:
            self.answer(packet, now)
        body, told = packet[2:-3], int.from_bytes(packet[-3:-1], "big")
        if packet[1] < 4 or packet[-1] != ETX or crc(body) != told:
            self._send(f"{self.lasting['address']:02d}{self._state()}?COM", now, safe=True)  # MAN: invalid packet
            return
        self._command(body, now, packet=True)
        if self.lasting["SAF"]:
            self.put(now, safe_timer_ends=now + self.lasting["SAF"])  # MAN: each valid packet resets the time-out

    def _send(self, text, now, safe=None):
        data = text.encode("latin-1")
        if self.lasting["SAF"] if safe is None else safe:
            # MAN: the length counts what remains, itself too
            self.answer(bytes([STX, len(data) + 4]) + data + crc(data).to_bytes(2, "big") + bytes([ETX]), now)
        else:
            self.answer(bytes([STX]) + data + bytes([ETX]), now)

    def _state(self):
        if self.purging:
            return "X"
        if self.running:
            return "I" if self.lasting["DIR"] == "INF" else "W"
        return "P" if self.paused else "S"

    def _status(self):
        return f"{self.lasting['address']:02d}" + (f"A?{self.alarm}" if self.alarm else self._state())

    def _command(self, data, now, packet=False):
        # MAN: stripped of all space and control characters, made upper case
        text = "".join(chr(each) for each in data if 0x20 < each < 0x7F).upper()
        self.tell(now, "command", text)
        form = re.fullmatch(r"(\*|\d{0,2})(.*)", text)
        if form[1] != "*" and int(form[1] or 0) != self.lasting["address"]:
            return
        if self.alarm:
            # MAN: the alarm status is sent in response to any valid command, and that acknowledges it
            told = self._status()
            self.put(now, alarm="")
            if form[2].startswith("SAF"):
                self._try(form[2], form[1] == "*", now)  # no source; NESP's first SAF may meet the alarm
            self._send(told, now)
            return
        told = self._try(form[2], form[1] == "*", now)
        self._send(self._status() + told, now)

    def _try(self, text, system, now):
        try:
            return self._act(text, system, now) or ""
        except Error as error:
            self.tell(now, "refused", text)
            return "?" + str(error)

    # -- commands ------------------------------------------------------------------------------------------

    def _act(self, text, system, now):
        if not text:
            return ""  # MAN: a packet without a command is a status query
        if system and text.startswith("ADR"):
            return self._set_address(text[3:], now)
        if system and text == "RESET":
            return self._master_reset(now)
        act = {"DIA": self._diameter, "RAT": self._rate, "VOL": self._volume, "DIR": self._direction, "RUN": self._run,
               "STP": self._stop, "PUR": self._purge, "DIS": self._dispensed, "CLD": self._clear, "SAF": self._safe,
               "VER": self._version}.get(text[:3])
        if act is None:
            raise Error("")  # MAN: not recognized: '?' only
        return act(text[3:], now)

    def _number(self, text, least, most):
        """MAN: at most four digits, one point, three digits to its right."""
        if not re.fullmatch(r"\d*\.?\d*", text) or not re.search(r"\d", text):
            raise Error("OOR")
        digits, behind = len(text.replace(".", "")), len(text.partition(".")[2])
        if self.strict and (digits > 4 or behind > 3):
            raise Error("OOR")  # no source: what is said of too many digits
        value = float(text)
        if not least <= value <= most:
            raise Error("OOR")
        return value

    def _keep(self, now, **values):
        self.put(now, lasting={**self.lasting, **values})

    def _diameter(self, text, now):
        if not text:
            return four(self.lasting["DIA"])
        if self._moving():
            raise Error("NA")  # no source: which commands are not applicable while pumping, but that NA is the word
        value = self._number(text, 0.1, 80.0)  # NESP
        # M500: at or below 14.00 mm microliters
        self._keep(now, DIA=value, volume_units="UL" if value <= 14.0 else "ML")
        return ""

    def _area(self):
        return math.pi / 4 * self.lasting["DIA"] ** 2  # mm^2

    def _rate(self, text, now):
        if not text:
            return four(self.lasting["RAT"]) + self.lasting["units"]
        form = re.fullmatch(r"([\d.]*)(MM|MH|UM|UH)?", text)
        if not form:
            raise Error("OOR")
        units = form[2] or self.lasting["units"]
        if self._moving() and units != self.lasting["units"]:
            raise Error("NA")  # M500 5.4.1: units cannot be changed while pumping
        value = self._number(form[1], 0.0, 9999.0)
        rate = value / PER_ML[units]
        if (value or self._moving()) and not SLOWEST * self._area() / 1000 <= rate <= FASTEST * self._area() / 1000:
            raise Error("OOR")  # M500 quick start: out of range
        if self.running:
            self.put(now, rate_ml_s=rate)  # M500 5.4.1: at once, and not stored
        else:
            self._keep(now, RAT=value, units=units)
        return ""

    def _volume(self, text, now):
        if not text:
            return four(self.lasting["VOL"]) + self.lasting["volume_units"]
        if self._moving():
            raise Error("NA")
        if text in ("UL", "ML"):
            self._keep(now, volume_units=text)
        else:
            self._keep(now, VOL=self._number(text, 0.0, 9999.0))  # M500: 0 pumps continuously
        return ""

    def _direction(self, text, now):
        if not text:
            return self.lasting["DIR"]
        if text not in ("INF", "WDR", "REV"):
            raise Error("OOR")
        if self._moving() and self.lasting["VOL"]:
            raise Error("NA")  # M500 5.4.1: only if the volume to be dispensed is 0
        if text == "REV":
            text = "WDR" if self.lasting["DIR"] == "INF" else "INF"
        self._keep(now, DIR=text)
        return ""

    def _run(self, text, now):
        if text not in ("", "1"):
            raise Error("OOR")  # one phase is there
        if self._moving() or not self.lasting["RAT"]:
            raise Error("NA")
        if not self.paused:
            self._phase_ml = 0.0
        self.put(now, running=True, paused=False, rate_ml_s=self.lasting["RAT"] / PER_ML[self.lasting["units"]])
        return ""

    def _purge(self, text, now):
        if text or self._moving():
            raise Error("NA")
        self.put(now, purging=True, paused=False, rate_ml_s=FASTEST * self._area() / 1000)  # NESP: at maximum rate
        return ""

    def _stop(self, text, now):
        """F: pauses; again: stops."""
        if text:
            raise Error("")
        if self.purging:
            self.put(now, purging=False)
        elif self.running:
            self.put(now, running=False, paused=True)
        elif self.paused:
            self._phase_ml = 0.0
            self.put(now, paused=False)
        else:
            raise Error("NA")  # no source
        return ""

    def _dispensed(self, text, now):
        if text:
            raise Error("NA")
        scale = 1.0 if self.lasting["volume_units"] == "ML" else 1e3
        # NESP, F: I0.000W0.000ML
        return f"I{four(self.infused_ml * scale)}W{four(self.withdrawn_ml * scale)}{self.lasting['volume_units']}"

    def _clear(self, text, now):
        if text not in ("INF", "WDR"):
            raise Error("OOR")
        if self._moving():
            raise Error("NA")
        self.put(now, **({"infused_ml": 0.0} if text == "INF" else {"withdrawn_ml": 0.0}))
        return ""

    def _safe(self, text, now):
        if not text:
            return str(self.lasting["SAF"])
        if not text.isdigit() or int(text) > 255:
            raise Error("OOR")  # NESP: 0 to 255 s
        self._keep(now, SAF=int(text))
        self.put(now, safe_timer_ends=None)
        return ""

    def _version(self, text, now):
        if text:
            raise Error("NA")  # M9000: set is not applicable
        return self.version

    def _set_address(self, text, now):
        """M9000: *ADR asks, *ADR 3 sets; baud rates are not carried here."""
        if not text:
            return f"{self.lasting['address']:02d}"
        if not text.isdigit() or int(text) > 99:
            raise Error("OOR")
        self._keep(now, address=int(text))
        return ""

    def _master_reset(self, now):
        """M9000: clears program memory, basic mode, address 0."""
        self.put(now, running=False, paused=False, purging=False, safe_timer_ends=None)
        self._keep(now, SAF=0, address=0, VOL=0.0, DIR="INF")
        return ""


DOUBLE = NewEra
