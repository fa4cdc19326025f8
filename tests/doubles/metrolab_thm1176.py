"""A Metrolab THM1176 three-axis field probe: USBTMC with USB488, SCPI.

Sources, named by their letters at the lines below:
  MAN  Metrolab THM1176/TFM1186 user's manual v1.3 r1.4 (in github elaird/thm1176), chapters 6 (commands), 7, 9 (errors)
  REC  the same repository: mag_usbtmc.py and what it recorded with a real THM1176-MF (2018-07-24-mnp22)
  PY   github Hyperfine/pyTHM1176 thm_usbtmc_api.py: what an answer is taken apart into
  F    the project's fact sheet scripted_instruments, B 3
SPDX-License-Identifier: Apache-2.0
"""

import math
import re
import struct

from scpi import ScpiError, Tree
from usbtmc import UsbtmcDouble

RANGES = (0.1, 0.3, 1.0, 3.0)  # T: MAN 6-6 SENSe, THM1176-MF; REC ":SENS:ALL?"
# MAN 9: what it can say. no source for the texts but the manual's headings
TEXTS = {
    0: "No error", -102: "Syntax error", -104: "Data type error", -115: "Unexpected number of parameters",
    -221: "Settings conflict", -222: "Data out of range", -410: "Query INTERRUPTED", -420: "Query UNTERMINATED",
    -440: "Query UNTERMINATED after indefinite response", 103: "Wrong units for parameter",
    204: "Data buffer was overrun", 205: "Measurements were over-range", 206: "Timer was overrun",
}
SAMPLE = 1 / 6800.0  # s; MAN 7-1: approx. 6.8 kSa/s
BUFFER = 4096  # samples; MAN 7-1
TICK = 167  # ns; MAN :FETCh:TIMestamp?
UNITS = {"T": 1.0, "MT": 1e3, "UT": 1e6, "GAUS": 1e4, "KGAU": 10.0, "MAHZ": 42.577}  # MAN 7-1; MHz p: proton resonance
PREFIX = {"": 1.0, "N": 1e-9, "U": 1e-6, "M": 1e-3, "K": 1e3, "MA": 1e6}  # MAN 6-6
EAV, QSB, MAV, ESB, OSB = 4, 8, 16, 32, 128  # MAN 6-3
RANGE_OVER, FREQUENCY = 1 << 9, 1 << 5  # MAN 6-3, QUEStionable


class Wait(Exception):
    """A command that is carried out later."""

    def __init__(self, until):
        super().__init__(until)
        self.until = until


class MetrolabThm1176(UsbtmcDouble):
    """The probe, and the field at it."""

    OPTIONS = {
        **UsbtmcDouble.OPTIONS,
        "identity": "Metrolab Technology SA,THM1176-MF,0000803,elD1-prD0-fw3.1",  # REC
        "zeroing": 6.0,  # s; REC: CAL:INIT and CAL:ZERO take approximately 6 seconds
        "unit_letters": "upper",  # no source: whether MT comes back as MT or mT
        "fetch_waits": True,  # no source: whether FETCh waits for the acquisition, or is error -222 until it ends
    }
    STATE = ("field", "offset", "range", "auto", "average", "unit", "format", "trigger_count", "trigger_source", "timer",
             "continuous", "calibrated", "errors", "samples", "temperature", "asleep")
    VENDOR, PRODUCT = 0x1BFA, 0x0498  # F; REC

    def __init__(self, **options):
        self.field = [0.0, 0.0, 0.0]  # T at the probe
        self.offset = [0.0, 0.0, 0.0]  # T, what zeroing has taken off; FLASH: it lasts (MAN 9-3-3)
        self.temperature = 30000  # MAN: between 0 and 64 K, arbitrary units
        super().__init__(**options)

    def start(self, now):
        """Power-up, MAN 5-13."""
        super().start(now)
        self._born = now
        self._messages, self._units, self._unit = [], None, None
        self._busy_until = self._zero_ends = self._measuring = None
        self._events, self._enables = 0x80, {"ESE": 0, "SRE": 0, "OPER": 0, "QUES": 0}  # MAN 6-3: bit 7 power on
        self._ques_event = self._ques = self._oper_event = 0
        self.put(now, errors=[], asleep=False)
        self._reset(now)
        self._tree = self._commands()

    def _reset(self, now):
        """MAN 5-13 and the defaults of 6-6."""
        self.put(now, range=3.0, auto=True, average=1, unit="T", format=["ASC", 2], trigger_count=1, trigger_source="IMM",
                 timer=0.1, continuous=False, calibrated=True, samples=0)
        self._abort(now)

    def _abort(self, now):
        self._block, self._blocks, self._run = [], [], None  # what is fetched; what waits for it; what goes on
        self.put(now, continuous=False, samples=0)

    # -- acquisition -----------------------------------------------------------------------------------------

    def _begin(self, now, count):
        """Enables the trigger."""
        if self._run is not None:
            raise ScpiError(-221)
        wake = 0.1 if self.asleep else 0.0  # MAN :SYSTem:SLEEp: approximately 100 ms
        self.put(now, asleep=False)
        step = {"IMM": self._shot(), "TIM": self.timer, "BUS": None}[self.trigger_source]
        first = None if step is None else now + wake + self._shot()
        self._run = {"step": step, "next": first, "count": count, "got": []}
        self._block, self._blocks = [], []
        if self.trigger_source == "TIM" and self.timer < self._shot():
            self._error(206, now)  # MAN 9-6-4

    def _shot(self):
        return self.average * SAMPLE

    def _sample(self, now):
        """One sample: (x, y, z, time in ns)."""
        measured = [each - zero for each, zero in zip(self.field, self.offset)]
        most = max(map(abs, measured))
        if self.auto:
            # MAN 6-2 RANGing; no source for the place where it changes: the smallest range that holds it
            self.range = next((each for each in RANGES if most <= each), RANGES[-1])
        if most > self.range:
            self._error(205, now)
            self._ques |= RANGE_OVER
            self._ques_event |= RANGE_OVER
            measured = [max(-self.range, min(self.range, each)) for each in measured]
        ticks = int((now - self._born) * 1e9) // TICK * TICK
        return (*measured, ticks)

    def _take_sample(self, at):
        run = self._run
        run["got"].append(self._sample(at))
        self.samples += 1
        if run["step"] is not None:
            run["next"] = at + max(run["step"], self._shot() if self.trigger_source == "TIM" else 0.0)
        if len(run["got"]) < run["count"]:
            return
        if len(self._blocks) * run["count"] + run["count"] > BUFFER:
            self._error(204, at)  # MAN 9-6-2
            self._ques_event |= FREQUENCY
            self._blocks.pop(0)
        self._blocks.append(run["got"])
        run["got"] = []
        if not self.continuous:
            self._run = None

    def busy(self, now):
        """Whether a message is still being worked on."""
        return self._units is not None or bool(self._messages)

    def next_event(self):
        """The next sample, or the end of what a message waits for."""
        times = [self._busy_until] if self._busy_until is not None else []
        if self._run is not None and self._run["next"] is not None:
            times.append(self._run["next"])
        return min(times, default=None)

    def advance(self, now):
        """Samples, and goes on with a message that waits."""
        while (event := self.next_event()) is not None and event <= now:
            if self._run is not None and self._run["next"] == event:
                self._take_sample(event)
            else:
                self._busy_until = None
            super().advance(event)
            if self._busy_until is None and self._units is not None:
                self._work(event)
        super().advance(now)

    # -- messages --------------------------------------------------------------------------------------------

    def program(self, message, now):
        """A whole program message."""
        self.tell(now, "line", message.decode("latin-1").strip())
        self._messages.append(message.decode("latin-1").strip())
        self._work(now)

    def trigger(self, now):
        """MAN 6-4: TRIGGER asserts the bus trigger."""
        self._bus_trigger(now)
        if self._units is not None and self._busy_until is None:
            self._work(now)

    def _bus_trigger(self, now):
        if self.trigger_source != "BUS" or self._run is None:
            self._error(-221, now)  # MAN 9-3-1
            return
        self._take_sample(now)

    def reset_input(self, now):
        """INITIATE_CLEAR: MAN 6-4."""
        self._messages, self._units, self._unit, self._busy_until = [], None, None, None
        self._zero_ends = self._measuring = None

    def query_error(self, code, now):
        """MAN 9-4-2, 9-4-3."""
        self._error(code, now)

    def _error(self, code, now):
        self._events |= 0x20 if -200 < code <= -100 else 0x04 if code <= -400 else 0x10 if code < 0 else 0x08  # MAN 6-3
        self.put(now, errors=self.errors + [code])

    def _work(self, now):
        """Carries out what has come, as far as it goes; a response is sent when its message has been worked through."""
        while self._messages or self._units is not None:
            if self._units is None:
                self._units, self._unit = self._tree.units(self._messages.pop(0)), None
                self._replies, self._block = [], self._block if not self.continuous else []
                self._indefinite = False
            try:
                while True:
                    if self._unit is None:
                        self._unit = next(self._units)
                    self._one(*self._unit, now)
                    self._unit = None
            except Wait as wait:
                self._busy_until = wait.until
                return
            except StopIteration:
                pass
            except ScpiError as error:
                self._error(error.code if error.code in TEXTS else -102, now)  # MAN 9-2: -102 for an unknown header
            self._units = None
            if self._replies:
                self.respond(b";".join(self._replies) + b"\n", now)  # IEEE 488.2: semicolons, a line feed

    def _one(self, handler, argument, query, now):
        if query and self._indefinite:
            raise ScpiError(-440)  # MAN 6-5, 9-4-4: nothing can be asked behind *IDN?
        told = handler(argument, now)
        if query:
            data = told if isinstance(told, bytes) else str(told).encode("latin-1")
            if self._replies and data.startswith(b"#"):
                # PY parse_binary_responses: blocks begin at multiples of four. no source for what fills the gap
                before = sum(len(each) + 1 for each in self._replies)
                data = b" " * (-before % 4) + data
            self._replies.append(data)

    def status_byte(self, now):
        """MAN 6-3."""
        bits = (EAV if self.errors else 0) | (MAV if self.output_ready else 0)
        bits |= QSB if self._ques_event & self._enables["QUES"] else 0
        bits |= ESB if self._events & self._enables["ESE"] else 0
        bits |= OSB if self._oper_event & self._enables["OPER"] else 0
        return bits | (0x40 if bits & self._enables["SRE"] else 0)

    # -- arguments -------------------------------------------------------------------------------------------

    @staticmethod
    def _parts(argument):
        return [each.strip() for each in argument.split(",")] if argument else []

    @staticmethod
    def _number(text, unit, least, most, default):
        """A number with its unit; MINimum, MAXimum, DEFault."""
        word = text.upper()
        for short, whole, value in (("MIN", "MINIMUM", least), ("MAX", "MAXIMUM", most), ("DEF", "DEFAULT", default)):
            if word in (short, whole):
                return value
        form = re.fullmatch(r"([-+]?[\d.]+(?:E[-+]?\d+)?)\s*([A-Z]*)", word)
        if not form:
            raise ScpiError(-104)
        letters, factor = form[2], 1.0
        if letters:
            if not unit or not letters.endswith(unit) or letters[:-len(unit)] not in PREFIX:
                raise ScpiError(103)  # MAN 9-5-2
            factor = PREFIX[letters[:-len(unit)]]
        try:
            value = float(form[1]) * factor
        except ValueError:
            raise ScpiError(-104) from None
        if not least * (1 - 1e-9) <= value <= most * (1 + 1e-9):
            raise ScpiError(-222)
        return value

    @staticmethod
    def _word(argument, *words):
        """One of the words, short or long."""
        for word in words:
            if (argument or "").upper() in ("".join(c for c in word if c.isupper()), word.upper()):
                return "".join(c for c in word if c.isupper())
        raise ScpiError(-222)  # MAN 9-3-2: a character parameter that is none of the choices

    def _boolean(self, argument, default):
        word = (argument or "").upper()
        if word in ("DEF", "DEFAULT"):
            return default
        if word not in ("ON", "OFF", "0", "1"):
            raise ScpiError(-104)
        return word in ("ON", "1")

    # -- commands --------------------------------------------------------------------------------------------

    def _commands(self):
        tree = {
            "*IDN?": self._identify, "*RST": lambda a, now: self._reset(now), "*CLS": self._clear,
            "*ESR?": self._take_events, "*STB?": lambda a, now: self.status_byte(now), "*OPC?": self._complete,
            "*OPC": self._flag_complete, "*WAI": self._complete, "*TST?": lambda a, now: 0,
            "*TRG": lambda a, now: self._bus_trigger(now),
            "ABORt": lambda a, now: self._abort(now),
            "[CALCulate:]AVERage:COUNt": self._set_average, "[CALCulate:]AVERage:COUNt?": lambda a, now: self.average,
            "CALibration[:INITiate]": self._zero, "CALibration:ZERO": self._factory_zero,
            "CALibration:STATe": lambda a, now: self.put(now, calibrated=self._boolean(a, True)),
            "CALibration:STATe?": lambda a, now: self._on(self.calibrated),
            "FETCh[:SCALar]:TIMestamp?": lambda a, now: f"0x{self._data(1, now)[-1][3]:016X}",  # PY: int(text, 0)
            "FETCh[:SCALar]:TEMPerature?": lambda a, now: self._data(1, now) and self.temperature,
            "FORMat[:DATA]": self._set_format, "FORMat[:DATA]?": lambda a, now: self.format[0],
            "INITiate[:IMMediate][:ALL]": lambda a, now: self._begin(now, self.trigger_count),
            "INITiate:CONTinuous": self._set_continuous, "INITiate:CONTinuous?": lambda a, now: self._on(self.continuous),
            "SENSe[:FLUX][:RANGe][:UPPer]": self._set_range,
            "SENSe[:FLUX][:RANGe][:UPPer]?": lambda a, now: f"{self.range:g} T",
            "SENSe[:FLUX][:RANGe][:UPPer]:AUTO": lambda a, now: self.put(now, auto=self._boolean(a, True)),
            "SENSe[:FLUX][:RANGe][:UPPer]:AUTO?": lambda a, now: self._on(self.auto),  # REC: ON
            "SENSe[:FLUX][:RANGe][:UPPer]:ALL?": lambda a, now: ",".join(f"{each:g} T" for each in RANGES),  # REC
            "SYSTem:ERRor[:NEXT]?": self._next_error, "SYSTem:VERSion?": lambda a, now: "1999.0", "SYSTem:SLEEp": self._sleep,
            "TRIGger:COUNt": self._set_count, "TRIGger:COUNt?": lambda a, now: self.trigger_count,
            "TRIGger:SOURce": self._set_source, "TRIGger:SOURce?": lambda a, now: self.trigger_source,
            "TRIGger:TIMer": self._set_timer, "TRIGger:TIMer?": lambda a, now: f"{self.timer:g} S",
            "UNIT": self._set_unit, "UNIT?": lambda a, now: self.unit,
            "STATus:QUEStionable[:EVENt]?": self._take_questionable,
            "STATus:QUEStionable:CONDition?": lambda a, now: self._ques,
            "STATus:PRESet": lambda a, now: self._enables.update(OPER=0, QUES=0),
        }
        for name, key in (("*ESE", "ESE"), ("*SRE", "SRE"), ("STATus:OPERation:ENABle", "OPER"),
                          ("STATus:QUEStionable:ENABle", "QUES")):
            tree[name] = lambda a, now, key=key: self._enables.update({key: int(self._number(a or "x", "", 0, 32767, 0))})
            tree[name + "?"] = lambda a, now, key=key: self._enables[key]
        for axis, word in enumerate((":X", "[:Y]", ":Z")):
            for verb in ("FETCh", "MEASure", "READ"):
                tree[f"{verb}[:SCALar][:FLUX]{word}?"] = lambda a, now, v=verb, n=axis: self._ask(v, n, False, a, now)
                tree[f"{verb}:ARRay[:FLUX]{word}?"] = lambda a, now, v=verb, n=axis: self._ask(v, n, True, a, now)
        return Tree(tree)

    @staticmethod
    def _on(flag):
        return "ON" if flag else "OFF"

    def _identify(self, argument, now):
        self._indefinite = True
        return self.identity

    def _clear(self, argument, now):
        self._events = self._ques_event = self._oper_event = 0
        self.put(now, errors=[])

    def _take_events(self, argument, now):
        told, self._events = self._events, 0
        return told

    def _take_questionable(self, argument, now):
        told, self._ques_event = self._ques_event, 0
        return told

    def _next_error(self, argument, now):
        code = self.errors[0] if self.errors else 0
        self.put(now, errors=self.errors[1:])
        return f'{code},"{TEXTS[code]}"'  # PY check_error: the first character is 0 when there is none

    def _complete(self, argument, now):
        if self._run is not None and not self.continuous:
            raise Wait(self._end(now))
        return 1

    def _flag_complete(self, argument, now):
        self._complete(argument, now)
        self._events |= 1

    def _end(self, now):
        """When the acquisition may end; None where that is the host's."""
        run = self._run
        return None if run["next"] is None else run["next"] + (run["count"] - len(run["got"]) - 1) * run["step"]

    def _sleep(self, argument, now):
        if self._run is not None:
            raise ScpiError(-221)  # MAN 9-3-1
        self.put(now, asleep=True)

    def _zero(self, argument, now):
        """MAN: measures the offset in the zero gauss chamber; REC: six seconds."""
        if self._run is not None:
            raise ScpiError(-221)
        self._take_time(now)
        self.put(now, offset=list(self.field))

    def _factory_zero(self, argument, now):
        self._take_time(now)
        self.put(now, offset=[0.0, 0.0, 0.0])

    def _take_time(self, now):
        if self._zero_ends is None:
            self._zero_ends = now + self.zeroing
        if now < self._zero_ends - 1e-9:
            raise Wait(self._zero_ends)
        self._zero_ends = None

    def _set_average(self, argument, now):
        self.put(now, average=int(self._number(argument or "x", "", 1, 16384, 1)))  # no source for the maximum

    def _set_format(self, argument, now):
        parts = self._parts(argument)
        if not 1 <= len(parts) <= 2:
            raise ScpiError(-115)
        word = self._word(parts[0], "ASCii", "INTeger", "PACKed", "DEFault")
        if len(parts) == 2 and word != "PACK":
            raise ScpiError(-222)  # MAN 9-3-2
        length = int(self._number(parts[1], "", 1, 2, 2)) if len(parts) == 2 else 2
        self.put(now, format=["ASC" if word == "DEF" else word, length])

    def _set_range(self, argument, now):
        """MAN: selecting a range; F: the automatic one has to be switched off by itself. 9-3-1 in a bus acquisition."""
        if self._run is not None and self.trigger_source == "BUS":
            raise ScpiError(-221)
        value = self._number(argument or "x", "T", 0.0, 20.0, RANGES[-1])
        fits = [each for each in RANGES if abs(each - value) < 1e-6]
        if (argument or "").upper()[:3] in ("MIN", "MAX", "DEF"):
            fits = [RANGES[0] if argument.upper().startswith("MIN") else RANGES[-1]]
        if not fits:
            raise ScpiError(-222)  # MAN 9-3-2: the requested range does not exist
        self.put(now, range=fits[0])

    def _set_continuous(self, argument, now):
        on = self._boolean(argument, False)
        if on and self.trigger_source != "TIM":
            raise ScpiError(-221)  # MAN 6-6: only if TRIGger:SOURce is TIMer; 9-3-1
        if on:
            self._block, self._blocks = [], []  # MAN :FETCh: continuous initiation invalidates what there is
        self.put(now, continuous=on)

    def _trigger_changed(self, now):
        """MAN: resets the trigger system; what was acquired is invalid."""
        self._abort(now)

    def _set_count(self, argument, now):
        count = int(self._number(argument or "x", "", 1, 2048, 1))
        self._trigger_changed(now)
        self.put(now, trigger_count=count)

    def _set_source(self, argument, now):
        word = self._word(argument, "IMMediate", "TIMer", "BUS", "DEFault")
        self._trigger_changed(now)
        self.put(now, trigger_source="IMM" if word == "DEF" else word)

    def _set_timer(self, argument, now):
        period = self._number(argument or "x", "S", 122e-6, 2.79, 0.1)
        self._trigger_changed(now)
        self.put(now, timer=period)

    def _set_unit(self, argument, now):
        word = self._word(argument, "T", "MT", "UT", "GAUSs", "KGAUss", "MAHZp", "DEFault")
        self.put(now, unit="T" if word == "DEF" else word)

    # -- values ----------------------------------------------------------------------------------------------

    def _ask(self, verb, axis, array, argument, now):
        """FETCh, READ or MEASure of one axis."""
        parts = self._parts(argument)
        size = int(self._number(parts.pop(0) if array and parts else "1", "", 1, 2048, 1))
        if verb != "FETCh" and parts:
            expected = parts.pop(0)
            if expected:
                value = self._number(expected, "T", 0.0, 20.0, 0.0)
                fits = [each for each in RANGES if each >= value]
                if not fits:
                    raise ScpiError(-222)  # MAN 9-3-2: the expected value is too large
                self.put(now, range=fits[0], auto=False)
        digits = int(self._number(parts.pop(0) if parts and parts[0] else "3", "", 1, 5, 3))
        if parts:
            raise ScpiError(-115)
        if verb != "FETCh":
            self._measure(verb, size, now)
        values = [each[axis] for each in self._data(size, now)]
        return self._formatted(values[-size:] if verb != "FETCh" else values[:size], digits)

    def _measure(self, verb, size, now):
        """MAN :READ: aborts pending triggers and measures; :MEASure with the default parameters. Waits for the end."""
        if self._unit is not None and self._measuring is self._unit:
            if self._run is not None:
                raise Wait(self._end(now))
            self._measuring = None
            return
        if verb == "READ" and self.trigger_source == "BUS":
            raise ScpiError(-221)  # MAN :READ: cannot be used when TRIGger:SOURce is BUS
        ranging = (self.range, self.auto)
        if verb == "MEASure":
            unit, form = self.unit, self.format
            self._reset(now)
            self.put(now, unit=unit, format=form, range=ranging[0], auto=ranging[1])
        self._abort(now)
        self._begin(now, size)
        self._measuring = self._unit
        raise Wait(self._end(now))

    def _data(self, size, now):
        """The block that is fetched. no source: in continuous mode one message fetches one block, the oldest."""
        if not self._block and self._blocks:
            self._block = self._blocks.pop(0)
        if not self._block and self._run is not None:
            if self.trigger_source == "BUS":
                raise ScpiError(-221)  # MAN 6-7: FETCh is illegal until all triggers have come
            if self.fetch_waits:
                raise Wait(self._end(now))
        if len(self._block) < size:
            raise ScpiError(-222)  # MAN 9-3-2: fetching more data than what was acquired
        return self._block

    def _formatted(self, tesla, digits):
        if self.format[0] == "ASC":
            scaled, full = UNITS[self.unit], self.range * UNITS[self.unit]
            # REC: 5 digits of 0.1 T are +0.003995 T, of a higher range -0.03404 T
            behind = max(0, digits - math.ceil(math.log10(full) - 1e-9))
            name = self.unit if self.unit_letters == "upper" else self.unit.lower().replace("t", "T")
            return ",".join(f"{each * scaled:+.{behind}f} {name}" for each in tesla)
        whole = [round(each * 1e6) for each in tesla] if self.calibrated else [round(each / self.range * 8192) for each in tesla]
        if self.format[0] == "INT":
            # MAN :FORMat: a header of 8 bytes #6nnnnnn, 32-bit big-endian signed integers in uT
            data = struct.pack(f">{len(whole)}i", *whole)
            return b"#6%06d" % len(data) + data
        length = self.format[1]
        most = 127 if length == 1 else 32767
        data, last = str(length).encode() + struct.pack(">i", whole[0]), whole[0]
        for each in whole[1:]:
            delta = max(-most, min(most, each - last))  # MAN 9-6-5: the largest step there is
            data += delta.to_bytes(length, "big", signed=True)
            last += delta
        return b"#5%05d" % len(data) + data


DOUBLE = MetrolabThm1176
