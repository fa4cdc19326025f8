"""A Harvard Apparatus Pump 11 syringe pump on its pump chain.

Sources, named by their letters at the lines below:
  PUMPY  github tomwphillips/pumpy pumpy.py: what a public program sends and how many bytes of which it reads
  P22    a public program's notes on the Pump 22 and Pump 11 Plus manuals: the three bytes CR LF prompt, the four prompts
  F      the project's fact sheet scripted_instruments, B 4
SPDX-License-Identifier: Apache-2.0
"""

import math
import re

from double import ByteDouble

# microliters a second in one of each unit: PUMPY ULM, and the family's names MLM, ULH, MLH (no source at hand for the three)
UNITS = {"ULM": 1 / 60.0, "MLM": 1000 / 60.0, "ULH": 1 / 3600.0, "MLH": 1000 / 3600.0}
FASTEST = 47.0 / 60  # mm/s; no source at hand: some 26 ml/min with a 50 ml syringe


class HarvardPump11(ByteDouble):
    """The pump and its syringe."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "address": 0,
        "version": "    11 1.0",  # PUMPY reads 17 bytes in all: ten for the text; no source for the text
        "target_unit": "ul",  # PUMPY: MLT is in microliters for the Pump 11, in milliliters for a PHD2000
        "address_digits": 2,  # PUMPY: a Pump 11 answers 03, a PHD2000 3
        "reverses": True,  # False: a pump that only infuses: REV is NA
        "chatty": False,  # each prompt twice, as when a second pump has the same address
    }
    STATE = ("diameter_mm", "rate", "units", "rate_ul_s", "direction", "running", "stalled", "volume_ul", "target_ul",
             "plunger_ul", "blocked")

    def __init__(self, **options):
        self.diameter_mm, self.blocked, self.plunger_ul = 10.0, False, 0.0
        super().__init__(**options)

    def start(self, now):
        """Power-up. no source for what it keeps: the diameter."""
        self._line = bytearray()
        self.put(now, rate=0.0, units="ULM", direction=1, running=False, stalled=False, volume_ul=0.0, target_ul=0.0)
        self.now = now

    @property
    def rate_ul_s(self):
        """What flows, out of the syringe."""
        return self.direction * self.rate * UNITS[self.units] if self.running and not self.blocked else 0.0

    # -- time ----------------------------------------------------------------------------------------------

    def next_event(self):
        """The target volume, or a stall."""
        if not self.running:
            return None
        if self.blocked:
            return self.now
        if self.target_ul and self.rate:
            return self.now + max(0.0, self.target_ul - self.volume_ul) / abs(self.rate_ul_s)
        return None

    def advance(self, now):
        """Pumps on."""
        while (event := self.next_event()) is not None and event <= now:
            self._pump(event)
            if self.blocked:
                self.put(event, running=False, stalled=True)
            else:
                self.put(event, running=False, volume_ul=self.target_ul)
                self.tell(event, "target", self.volume_ul)
        self._pump(now)

    def _pump(self, now):
        moved = abs(self.rate_ul_s) * max(0.0, now - self.now)
        self.volume_ul += moved
        self.plunger_ul += self.direction * moved
        super().advance(now)

    # -- the line ------------------------------------------------------------------------------------------

    def take(self, byte, now):
        """F: an address, a command and a carriage return."""
        if byte == 0x0D:
            line = self._line.decode("latin-1").strip().upper()
            self._line.clear()
            form = re.fullmatch(r"(\d{0,2})\s*([A-Z]*)\s*([-\d.]*)", line)
            if form and int(form[1] or 0) != self.address:
                return
            self.tell(now, "line", line)
            self._reply(self._act(form[2], form[3], now) if form else "?", now)
        elif byte != 0x0A:
            self._line.append(byte)

    def _reply(self, text, now):
        # P22: CR LF prompt; PUMPY: CR LF, two digits of address, the prompt; a value stands on a line before it
        end = f"\r\n{self.address:0{self.address_digits}d}{self._prompt()}"
        self.answer(((f"\r\n{text}" if text else "") + end * (2 if self.chatty else 1)).encode("latin-1"), now)

    def _prompt(self):
        if self.stalled:
            return "*"  # P22
        if not self.running:
            return ":"
        return ">" if self.direction > 0 else "<"

    def _act(self, name, argument, now):
        if name in UNITS:
            return self._set_rate(name, argument, now)
        ask = {"": "", "VER": self.version, "DIA": self._field(self.diameter_mm), "RAT": self._field(self.rate),
               "VOL": self._field(self.volume_ul), "TAR": self._field(self.target_ul)}
        if name in ask and not argument:
            return ask[name]
        act = {"MMD": self._set_diameter, "MLT": self._set_target, "RUN": self._run, "STP": self._stop, "REV": self._reverse,
               "CLV": self._clear_volume, "CLT": self._clear_target}.get(name)
        return "?" if act is None else act(argument, now)

    @staticmethod
    def _field(value):
        """PUMPY: eight characters; a diameter in 3 to 8, a rate in 2 to 7 of what is read. no source for the blanks."""
        return f"{value:8.3f}"[:8]

    def _number(self, argument):
        """PUMPY: a field width of 5, as XXXX. or X.XXX; None for what is no number."""
        if not re.fullmatch(r"\d*\.?\d*", argument) or not re.search(r"\d", argument):
            return None
        return float(argument[:5] if self.strict else argument)  # PUMPY: greater precision is truncated

    def _set_diameter(self, argument, now):
        value = self._number(argument)
        if value is None:
            return "?"
        if self.running:
            return "NA"
        if not 0.1 <= value <= 35:  # PUMPY
            return "OOR"
        self.put(now, diameter_mm=int(value * 100 + 1e-6) / 100, rate=0.0)  # PUMPY: two decimals; no source for the rate
        return ""

    def _set_rate(self, name, argument, now):
        value = self._number(argument)
        if value is None:
            return "?"
        if value * UNITS[name] > FASTEST * math.pi / 4 * self.diameter_mm**2:
            return "OOR"  # PUMPY: depends on the diameter
        self.put(now, rate=value, units=name)
        return ""

    def _set_target(self, argument, now):
        value = self._number(argument)
        if value is None:
            return "?"
        self.put(now, target_ul=value * (1.0 if self.target_unit == "ul" else 1000.0))
        return ""

    def _run(self, argument, now):
        if not self.rate:
            return "OOR"  # no source
        if self.target_ul and self.volume_ul >= self.target_ul:
            self.volume_ul = 0.0  # no source: a new run begins at zero; PUMPY runs again without CLV
        self.put(now, running=True, stalled=False)
        return ""

    def _stop(self, argument, now):
        self.put(now, running=False, stalled=False)
        return ""

    def _reverse(self, argument, now):
        """PUMPY withdraw(): at rest the prompt stays :, in motion it turns."""
        if not self.reverses:
            return "NA"
        self.put(now, direction=-self.direction)
        if self.target_ul:
            self.volume_ul = 0.0
        return ""

    def _clear_volume(self, argument, now):
        self.put(now, volume_ul=0.0)
        return ""

    def _clear_target(self, argument, now):
        self.put(now, target_ul=0.0)
        return ""


DOUBLE = HarvardPump11
