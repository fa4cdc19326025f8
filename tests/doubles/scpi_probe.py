"""Field meters that are asked by text: Lake Shore 421, 425, 460, 475, and the SCPI teslameter F71 (and F41).

Sources, named by their letters at the lines below:
  M421  Lake Shore Model 421 user's manual, pages 4-11, 4-12
  M425  Lake Shore Model 425 user's manual, pages 52, 56, 57 (chapter 6)
  M460  Lake Shore Model 460 user's manual, page 4-15
  M475  Lake Shore Model 475 user's manual, pages 6-7, 6-8 (status registers), 6-28, 6-38
  PM    github pymeasure/pymeasure pymeasure/instruments/lakeshore/lakeshore421.py, lakeshore425.py, test_lakeshore421.py
  IK    github instrumentkit/InstrumentKit tests/test_lakeshore/test_lakeshore475.py
  MPI   a public Julia driver of the 460 (GaussMeter, 7 bits odd parity, CR LF, *IDN? of a real one) and of the F71
  ISIS  ISIS' Lakeshore460 emulator (commands, CR LF, several commands on a line separated by semicolons)
  M218  Lake Shore Model 218 user's manual, page 6-10: message flow
  LS    Lake Shore's own Python driver (teslameter.py and its tests), NICOS' F71Teslameter
  SCPI  SCPI-99
SPDX-License-Identifier: Apache-2.0
"""

import math

from double import ByteDouble, Refused
from scpi import ScpiError, TEXTS, Tree

GAUSS = 1e-4  # T
OERSTED_T = 1e-4  # T in air
AMPERE_PER_METRE_T = 4e-7 * math.pi

IDENTITIES = {
    "421": "LSCI,MODEL421,0,070199",  # M421 example
    "425": "LSCI,MODEL425,4250022,1.0",  # M425 example
    "460": "LSCI,MODEL460,0,032406",  # MPI: the answer of a real one
    "475": "LSCI,MODEL475,4750001,1.0",  # no source for the numbers; M425's form
    "f71": "Lake Shore,F71,LSA1234,1.5.2019",  # no source
}
# Full scale of the ranges 0 (highest) to 3 for a high-sensitivity probe: PM RANGES in gauss.
RANGES_421 = (30e3, 3e3, 300.0, 30.0)
# PM lakeshore425: 1: 35 G, 2: 350, 3: 3500, 4: 35000
RANGES_425 = {1: 35.0, 2: 350.0, 3: 3500.0, 4: 35e3}
PREFIXES = {1e3: "k", 1.0: "", 1e-3: "m", 1e-6: "u"}  # PM MULTIPLIERS writes n for 1e-6, ISIS u


class ScpiProbe(ByteDouble):
    """The meter and the field at its probe."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "model": "475",
        "identity": "",  # another answer to *IDN?
        "terminator": "crlf",  # or lf, cr: what ends a reply
        "parity": False,  # bytes as a host sees them that set 8N1 on a line that is 7 bits, odd parity (PM, MPI, M460)
        "pause": 0.05,  # 421, 460: PM: 50 ms between writes, "the instrument cannot correctly handle writes any faster"
        "blank": " ",  # no source: what FIELDM? answers for a multiplier of 1: a blank, or nothing (PM maps '')
        "silent": False,  # answers nothing, as with a cable that is not plugged in
        # no source for three things of the 425 and the 475; 0 and "" leave them out:
        "flow": False,  # 425, 475: what comes within `pause` of an answer is lost too (M218 6-10, the same maker's)
        "zeroing": 0.0,  # s that ZPROBE takes; until then the reading is the old one and *OPC? waits (M475 6-28)
        "overload": "",  # what RDGFIELD? says of a field beyond a range that is fixed; "": the field
        "chatty": False,  # a terminator by itself ahead of each reply, as a converter that was plugged in leaves it
    }
    STATE = ("field", "unit", "range", "auto", "channel", "zero", "errors", "lost", "settings", "probe", "peaks",
             "temperature", "events", "zero_ends")

    def __init__(self, **options):
        self.field = [0.0, 0.0, 0.0]  # T at the probe: x, y, z; a meter of one axis measures z
        self.probe = True
        self.lost = 0
        self.temperature = 25.0  # degC at the probe
        super().__init__(**options)
        if self.model not in IDENTITIES:
            raise Refused(f"no model '{self.model}'; there are {', '.join(IDENTITIES)}")

    def start(self, now):
        """Power-up. no source for what a meter starts with; gauss, automatic range."""
        self._line = bytearray()
        self._last_line = -1.0
        self._last_query = ""
        letters = self.model in ("421", "460")
        self.put(now, unit="G" if letters or self.model == "f71" else 1, range=[0, 0, 0] if letters else 4,
                 auto=[True] * 3 if letters else True, channel="X", zero=[0.0, 0.0, 0.0], errors=[],
                 settings={}, peaks=[0.0, 0.0], zero_ends=None, events=0x80)  # M475 6-8: bit 7, power on
        self._held = []
        self._tree = Tree({
            "*IDN?": lambda a: self.identity or IDENTITIES["f71"], "*RST": lambda a: None, "*CLS": self._clear,
            "*OPC?": lambda a: "1", "*ESR?": lambda a: "0",
            "FETCh[:FIELd]:DC?": self._fetch,  # LS; another public F71 driver has FETCh:FIELd:DC? ALL
            "FETCh:TEMPerature?": lambda a: "+2.2500E+01",  # no source for the number of digits
            "UNIT[:FIELd]": self._set_unit, "UNIT[:FIELd]?": lambda a: {"G": "GAUSS", "T": "TESLA"}[self.unit],
            "SENSe:MODE": lambda a: self.settings.update(mode=a), "SENSe:RANGe:AUTO": lambda a: None,
            "SENSe:AVERage:COUNt": lambda a: None, "PROBe:AXES?": lambda a: "3",
            "SYSTem:ERRor?": self._next_error, "SYSTem:ERRor:ALL?": self._all_errors,
        })

    # -- the line ------------------------------------------------------------------------------------------

    def take(self, byte, now):
        """One byte of the host."""
        if self.parity:
            if bin(byte).count("1") % 2 == 0:
                return  # a parity error: the character is lost
            byte &= 0x7F
        if byte in (0x0D, 0x0A):
            line = self._line.decode("latin-1").strip()
            self._line.clear()
            if line:
                self._received(line, now)
        else:
            self._line.append(byte)

    def _received(self, line, now):
        self.tell(now, "line", line)
        hurried = now < self._last_line + self.pause - 1e-9 and self._last_line >= 0
        self._last_line = now
        if self.strict and hurried and (self.flow or self.model in ("421", "460")):
            self.put(now, lost=self.lost + 1)  # PM
            return
        if self.silent:
            return
        reply = self._scpi(line, now) if self.model == "f71" else self._plain_text(line, now)
        if reply is None:
            return
        self._say(reply, now)

    def _say(self, reply, now):
        end = {"crlf": "\r\n", "lf": "\n", "cr": "\r"}[self.terminator]
        data = bytearray(((end if self.chatty else "") + reply + end).encode("latin-1"))
        if self.parity:
            data = bytearray(each | (0x80 if bin(each).count("1") % 2 == 0 else 0) for each in data)
        self.answer(bytes(data), now)

    # -- time ----------------------------------------------------------------------------------------------

    def next_event(self):
        """The end of zeroing."""
        return self.zero_ends

    def advance(self, now):
        """Ends zeroing, keeps the peaks, and answers what waited for it."""
        super().advance(now)
        if self.zero_ends is not None and now >= self.zero_ends:
            ended = self.zero_ends
            self.put(ended, zero=list(self.field), zero_ends=None)
            held, self._held = self._held, []
            for reply in held:
                self._say(reply, ended)

    def arranged(self, now):
        """M475 6-38, RDGPEAK?: the most negative and the most positive field."""
        z = self._measured(2)
        self.put(now, peaks=[min(self.peaks[0], z), max(self.peaks[1], z)])

    def _plain_text(self, line, now):
        """Lake Shore's older meters: several commands on a line are separated by semicolons (ISIS)."""
        replies = []
        for unit in line.split(";"):
            words = unit.strip().split(None, 1)
            if not words:
                continue
            name, argument = words[0].upper(), words[1] if len(words) == 2 else ""
            act = self._commands().get(name)
            if act is None:
                self.tell(now, "unknown", unit)  # no source: an unknown command is passed over
                self.events |= 0x20  # M475 6-8: command error, bit 5: an unrecognized header
                continue
            told = act(argument, now)
            if told is not None:
                replies.append(told)
        return ";".join(replies) if replies else None

    def _commands(self):
        common = {
            "*IDN?": lambda a, now: self.identity or IDENTITIES[self.model],
            "*RST": lambda a, now: self.start(now), "*TST?": lambda a, now: "0",  # MPI, M475: no errors found
        }
        if self.model in ("421", "460"):
            common.update({
                "FIELD?": lambda a, now: self._field_421(), "FIELDM?": lambda a, now: self._prefix_421(),  # PM
                "UNIT?": lambda a, now: self.unit, "UNIT": self._unit_421,  # PM test_unit: G
                "RANGE?": lambda a, now: str(self._range()), "RANGE": self._range_421,
                "AUTO?": lambda a, now: str(int(self.auto[self._index()])), "AUTO": self._auto_421,
                "ACDC?": lambda a, now: str(self.settings.get("ACDC", "0")), "ACDC": self._keep("ACDC"),
                "FAST?": lambda a, now: str(self.settings.get("FAST", "0")), "FAST": self._keep("FAST"),
                "TYPE?": lambda a, now: "0", "SNUM?": lambda a, now: "H00001", "ZCAL": self._zero,
                "FILT": self._keep("FILT"), "LOCK": self._keep("LOCK"), "BAUD?": lambda a, now: "2",
            })
            if self.model == "460":
                common.update({
                    "CHNL?": lambda a, now: self.channel, "CHNL": self._channel_460,  # MPI, ISIS: X, Y, Z, V
                    "ALLF?": lambda a, now: self._all_460(),
                    "ONOFF?": lambda a, now: "0",  # MPI: 0 is on
                })
            return common
        common.update({
            "RDGFIELD?": lambda a, now: self._reading_425(),  # M475, PM: in the present unit
            "UNIT?": lambda a, now: str(self.unit), "UNIT": self._unit_425,  # M425: 1 G, 2 T, 3 Oe, 4 A/m
            "RANGE?": lambda a, now: str(self.range), "RANGE": self._range_425, "AUTO": self._auto_425,
            "AUTO?": lambda a, now: str(int(self.auto)), "*OPC?": self._complete,
            "*ESR?": self._events, "*CLS": lambda a, now: self.put(now, events=0),  # M475 6-7: reading clears it
            "TYPE?": lambda a, now: "40" if self.probe else "50",  # M425: 40 is a high-sensitivity probe
            "ZPROBE": self._zero, "RDGMODE?": lambda a, now: self.settings.get("RDGMODE", "1,3,1,1,1"),
            "RDGMODE": self._keep("RDGMODE"), "OPST?": lambda a, now: "000",
        })
        if self.model == "425":
            common["?"] = lambda a, now: self._reading_425()  # M425: reprocesses the last query; here the field
            common["RDGMODE?"] = lambda a, now: self.settings.get("RDGMODE", "1,0,1")  # PM: mode, filter, band
            common["RDGMX?"] = lambda a, now: self._exponent(max(map(abs, self.peaks)))  # M425 p. 56
            common["MXRST"] = self._forget_peaks  # no source at hand for the name
        else:
            # M475 6-38: <negative peak>,<positive peak>; the temperature in the present temperature units: degC
            common["RDGPEAK?"] = lambda a, now: ",".join(self._exponent(each) for each in self.peaks)
            common["RDGTEMP?"] = lambda a, now: self._exponent(self.temperature, 1.0)
            common["PKRST"] = self._forget_peaks  # no source at hand for the name
        return common

    def _keep(self, name):
        def keep(argument, now):
            self.put(now, settings={**self.settings, name: argument})
        return keep

    def _measured(self, axis):
        return self.field[axis] - self.zero[axis]

    # -- 421, 460: letters for units, a multiplier apart --------------------------------------------------

    def _index(self):
        return "XYZ".find(self.channel) if self.model == "460" and self.channel in "XYZ" else 2

    def _range(self, axis=None):
        axis = self._index() if axis is None else axis
        if self.auto[axis]:
            gauss = abs(self._measured(axis)) / GAUSS
            fitting = [n for n, full in enumerate(RANGES_421) if gauss < full]
            return max(fitting, default=0)
        return self.range[axis]

    def _scale_421(self, number):
        """(multiplier, digits behind the point) of a range: five digits in all."""
        full = RANGES_421[number] * (1.0 if self.unit == "G" else GAUSS)
        multiplier = max((each for each in PREFIXES if each <= full), default=1e-6)
        before = len(str(int(full / multiplier * 0.999)))
        return multiplier, 5 - before

    def _value_421(self, value, number):
        if abs(value) / GAUSS >= RANGES_421[number] * 1.0:
            return "OL"  # PM _raw_to_field
        multiplier, behind = self._scale_421(number)
        scaled = value / (GAUSS if self.unit == "G" else 1.0) / multiplier
        return f"{scaled:+0{7}.{behind}f}"  # M421: sign, five digits and a point

    def _vector(self):
        return math.sqrt(sum(self._measured(axis) ** 2 for axis in range(3)))

    def _field_421(self):
        if not self.probe:
            return "NP"  # no source: what a meter without a probe says
        if self.channel == "V":
            return self._value_421(self._vector(), 0)
        axis = self._index()
        return self._value_421(self._measured(axis), self._range(axis))

    def _prefix_421(self):
        number = 0 if self.channel == "V" else self._range()
        return PREFIXES[self._scale_421(number)[0]] or self.blank

    def _all_460(self):
        """MPI, and two more public programs: X, Y, Z and the vector, separated by commas.

        no source for the unit of each; here each in its own range, as FIELD? gives it."""
        told = [self._value_421(self._measured(axis), self._range(axis)) for axis in range(3)]
        return ",".join(told + [self._value_421(self._vector(), 0)])

    def _unit_421(self, argument, now):
        if argument.upper() in ("G", "T"):
            self.put(now, unit=argument.upper())

    def _range_421(self, argument, now):
        if argument in ("0", "1", "2", "3"):
            axis = self._index()
            self.put(now, range=[int(argument) if n == axis else old for n, old in enumerate(self.range)],
                     auto=[False if n == axis else old for n, old in enumerate(self.auto)])

    def _auto_421(self, argument, now):
        if argument in ("0", "1"):
            axis = self._index()
            self.put(now, auto=[argument == "1" if n == axis else old for n, old in enumerate(self.auto)])

    def _channel_460(self, argument, now):
        if argument.upper() in ("X", "Y", "Z", "V"):
            self.put(now, channel=argument.upper())

    def _zero(self, argument, now):
        if self.zeroing and self.model in ("425", "475"):
            self.put(now, zero_ends=now + self.zeroing)
            return
        self.put(now, zero=list(self.field))  # PM zero_probe; it takes some 20 s there

    def _forget_peaks(self, argument, now):
        self.put(now, peaks=[self._measured(2)] * 2)

    def _events(self, argument, now):
        told, self.events = self.events, 0
        return str(told)

    def _complete(self, argument, now):
        """M475 6-28: held until the operation is complete."""
        if self.zero_ends is None:
            return "1"
        self._held.append("1")
        return None

    # -- 425, 475: numbers for units, exponents -------------------------------------------------------------

    def _reading_425(self):
        value = self._measured(2)
        if self.overload and not self.auto and abs(value) > RANGES_425[self.range] * GAUSS:
            return self.overload
        return self._exponent(value)

    def _exponent(self, value, unit=None):
        """M475: format +-nnn.nnnE+-nn, in the present unit of the field unless told."""
        value /= unit or {1: GAUSS, 2: 1.0, 3: OERSTED_T, 4: AMPERE_PER_METRE_T}[self.unit]
        if value == 0:
            return "+000.000E+00"
        exponent = 3 * math.floor(math.log10(abs(value)) / 3)
        return f"{value / 10**exponent:+08.3f}E{exponent:+03d}"

    def _unit_425(self, argument, now):
        if argument in ("1", "2", "3", "4"):
            self.put(now, unit=int(argument))
        else:
            self.events |= 0x10  # M475 6-8: execution error, bit 4: not within its capabilities

    def _range_425(self, argument, now):
        if argument.isdigit() and int(argument) in RANGES_425:
            self.put(now, range=int(argument), auto=False)
        else:
            self.events |= 0x10

    def _auto_425(self, argument, now):
        self.put(now, auto=argument in ("", "1"))  # PM sends AUTO alone; no source for AUTO 0 on a 425

    # -- F71 -----------------------------------------------------------------------------------------------

    def _scpi(self, line, now):
        replies = []
        try:
            for handler, argument, query in self._tree.units(line):
                told = handler(argument)
                if query:
                    replies.append(told)
        except ScpiError as error:
            self.errors.append(error.code)
            self.tell(now, "error", error.code)
        return ";".join(replies) if replies else None  # LS: "123.456;No error"

    def _fetch(self, argument):
        """LS: FETCH:DC?, FETCH:DC? X, FETCH:DC? ALL: magnitude, x, y, z."""
        unit = GAUSS if self.unit == "G" else 1.0
        values = {"X": 0, "Y": 1, "Z": 2}
        word = (argument or "MAG").upper()
        if word == "ALL":
            told = [self._vector()] + [self._measured(axis) for axis in range(3)]
        elif word in values:
            told = [self._measured(values[word])]
        elif word in ("MAG", "MAGNITUDE"):
            told = [self._vector()]
        else:
            raise ScpiError(-141)
        return ",".join(f"{each / unit:+.6E}" for each in told)  # no source for the number of digits

    def _set_unit(self, argument):
        word = (argument or "").upper()
        if not word:
            raise ScpiError(-109)
        if word not in ("GAUSS", "TESLA"):  # MPI: UNIT:FIELD TESLA
            raise ScpiError(-141)
        self.unit = word[0]

    def _clear(self, argument):
        self.errors.clear()

    def _next_error(self, argument):
        code = self.errors.pop(0) if self.errors else 0
        return f'{code},"{TEXTS[code]}"'

    def _all_errors(self, argument):
        """LS: the driver asks for it behind each command and expects "No error"."""
        if not self.errors:
            return '0,"No error"'
        told = ",".join(f'{code},"{TEXTS[code]}"' for code in self.errors)
        self.errors.clear()
        return told


DOUBLE = ScpiProbe
