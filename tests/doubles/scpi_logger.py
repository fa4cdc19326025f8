"""Data loggers that scan voltages: HP/Agilent/Keysight 34970A and Keysight DAQ970A.

Sources, named by their letters at the lines below:
  M97   HP/Agilent 34970A User's Guide, chapters 4 and 5 (pages 73, 78, 228, 231, 235, 268, 280)
  MDAQ  Keysight DAQ970A/DAQ973A Programming Guide (pages 139, 149, 296)
  E1441 Agilent E1441A SCPI reference, p. 120 (the same family's error queue: +0,"No error")
  TV    Agilent Truevolt guide, p. 102 (separators)
  VG    a public Python driver of the 34970A/34972A by Dennis van Gils (rout:scan, init, fetch?)
SPDX-License-Identifier: Apache-2.0
"""

import re

from double import ByteDouble, Refused
from scpi import ScpiError, TEXTS, Tree

IDENTITIES = {
    "34970a": "HEWLETT-PACKARD,34970A,0,13-2-2",  # no source for the numbers
    "daq970a": "Keysight Technologies,DAQ970A,MY12345678,A.02.04-00.16-11.29-00.02-02-01",  # MDAQ p. 149
}
QUEUE = {"34970a": 10, "daq970a": 20}  # M97 p. 268; no source for the other
RANGES = (0.1, 1.0, 10.0, 100.0, 300.0)  # M97: dc volts
OVERLOAD = 9.9e37  # no source in the pages at hand; SCPI-99 7.2.1.4 has +-9.9E+37 for infinity
FIELDS = ("UNIT", "TIME", "CHAN", "ALAR")


class ScpiLogger(ByteDouble):
    """The logger, one multiplexer in slot 100, and what is at its terminals."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "model": "34970a",
        "terminator": "lf",  # or crlf: M97 has the latter for RS-232
        "switching": 0.004,  # s a channel. no source at hand; that of a reed multiplexer, some 250 channels a second
        "mains": 50.0,  # Hz: of the power line cycles of one reading
        "left": "",  # fields of FORMat:READing that somebody left on: "UNIT TIME ALAR"
        "silent": False,
        "wrong": "",  # an answer to READ? instead of the right one
    }
    STATE = ("volts", "scan", "ranges", "nplc", "fields", "errors", "readings", "source", "count")

    def __init__(self, **options):
        self.volts = {str(channel): 0.0 for channel in range(101, 121)}  # at the terminals
        super().__init__(**options)
        if self.model not in IDENTITIES:
            raise Refused(f"no model '{self.model}'; there are {', '.join(IDENTITIES)}")

    def start(self, now):
        """Power-up: no scan list."""
        self._line = bytearray()
        self._lines = []  # received during a scan
        self._busy = None  # [channels that are left, when the next is read, what was read]
        self.put(now, scan=[], ranges={}, nplc={}, errors=[], readings=0, source="IMM", count=1,
                 fields=[each for each in FIELDS if each in self.left.upper().split()])
        self._tree = Tree({
            "*IDN?": lambda a: IDENTITIES[self.model], "*RST": self._reset, "*CLS": self._clear,
            "*OPC?": lambda a: "1",
            "CONFigure:VOLTage[:DC]": self._configure,  # M97 p. 78: redefines the scan list
            "ROUTe:SCAN": self._set_scan, "ROUTe:SCAN?": lambda a: self._scan_list(),
            "ROUTe:SCAN:SIZE?": lambda a: str(len(self.scan)),  # M97 p. 228
            "[SENSe:]VOLTage[:DC]:NPLCycles": self._set_nplc,
            "FORMat:READing:UNIT": lambda a: self._field("UNIT", a), "FORMat:READing:TIME": lambda a: self._field("TIME", a),
            "FORMat:READing:CHANnel": lambda a: self._field("CHAN", a),
            "FORMat:READing:ALARm": lambda a: self._field("ALAR", a),
            "TRIGger:SOURce": self._set_source, "TRIGger:COUNt": self._set_count,
            "READ?": self._read, "SYSTem:ERRor?": self._next_error,
        })

    # -- the line ------------------------------------------------------------------------------------------

    def take(self, byte, now):
        """One byte of the host."""
        if byte != 0x0A:
            self._line.append(byte)
            return
        line = self._line.decode("latin-1").strip()
        self._line.clear()
        if line:
            self._lines.append(line)
            self._work(now)

    def _work(self, now):
        """A command that comes during a scan waits. no source: how a real one sees to that."""
        while self._lines and self._busy is None:
            line = self._lines.pop(0)
            self.tell(now, "line", line)
            replies = []
            try:
                for handler, argument, query in self._tree.units(line):
                    told = handler(argument)
                    if query and told is not None:
                        replies.append(told)
                    if self._busy is not None:
                        self._busy[1] = now + self._time_of(self._busy[0][0])
            except ScpiError as error:
                self._error(error.code, now)
            if replies:
                self._reply(";".join(replies), now)

    def _reply(self, text, now):
        if not self.silent:
            self.answer((text + {"lf": "\n", "crlf": "\r\n"}[self.terminator]).encode("latin-1"), now)

    def next_event(self):
        """The next channel's reading."""
        return None if self._busy is None else self._busy[1]

    def advance(self, now):
        """Reads the channels of a sweep, one after the other."""
        super().advance(now)
        while self._busy is not None and self._busy[1] <= now:
            channels, at, read = self._busy
            read.append(self._reading(channels.pop(0)))
            if channels:
                self._busy[1] = at + self._time_of(channels[0])
                continue
            self._busy = None
            self.put(at, readings=self.readings + len(read))
            self._reply(self.wrong or ",".join(read), at)
            self._work(at)

    def _time_of(self, channel):
        return self.switching + self.nplc.get(str(channel), 1.0) / self.mains

    def _reading(self, channel):
        """M97 p. 231 and 235, MDAQ p. 139: value, then time, channel and alarm as they were asked for."""
        volts, most = self.volts.get(str(channel), 0.0), self.ranges.get(str(channel), 300.0)
        if abs(volts) > 1.2 * most:  # no source in the pages at hand for the 20 % beyond the range
            volts = OVERLOAD if volts > 0 else -OVERLOAD
        text = f"{volts:+.8E}"  # M97 p. 235: +2.61920000E+01
        if "UNIT" in self.fields:
            text += " VDC"
        parts = [text]
        if "TIME" in self.fields:
            parts.append("000000000.017")
        if "CHAN" in self.fields:
            parts.append(str(channel))
        if "ALAR" in self.fields:
            parts.append("0")
        return ",".join(parts)

    # -- commands ------------------------------------------------------------------------------------------

    def _channels(self, text):
        """M97 p. 73: (@105:110,215); a range may hold channels that are not there, its ends may not."""
        found = re.fullmatch(r"\(\s*@\s*([0-9:, ]*)\)", text.strip())
        if not found:
            raise ScpiError(-102)
        channels = []
        for part in filter(None, (each.strip() for each in found[1].split(","))):
            ends = [int(each) for each in part.split(":")]
            if any(not 101 <= each <= 120 for each in ends) or len(ends) > 2 or ends[-1] < ends[0]:
                raise ScpiError(-222)
            channels += range(ends[0], ends[-1] + 1)
        return sorted(set(channels))  # no source in the pages at hand: the scan goes upwards whatever the list's order

    def _arguments(self, text):
        """Parameters and, last, the channel list."""
        if text is None:
            raise ScpiError(-109)
        at = text.find("(")
        if at < 0:
            return [each.strip() for each in text.split(",")], None
        before = text[:at].strip().rstrip(",")
        return [each.strip() for each in before.split(",") if each.strip()], self._channels(text[at:])

    def _number(self, text):
        try:
            return float(text)
        except ValueError:
            raise ScpiError(-120) from None

    def _configure(self, argument):
        given, channels = self._arguments(argument)
        if not channels:
            raise ScpiError(-109)
        wanted = self._number(given[0]) if given and given[0].upper() not in ("AUTO", "DEF") else 300.0
        fits = [each for each in RANGES if each >= wanted]
        if not fits:
            raise ScpiError(-222)
        for channel in channels:
            self.ranges[str(channel)] = fits[0]
            self.nplc[str(channel)] = 1.0
        self.scan = channels
        self.fields = [each for each in self.fields if each != "CHAN"]  # MDAQ p. 139

    def _set_scan(self, argument):
        if argument is None:
            raise ScpiError(-109)
        self.scan = self._channels(argument)

    def _scan_list(self):
        text = "(@" + ",".join(map(str, self.scan)) + ")"
        return f"#{len(str(len(text)))}{len(text)}{text}"  # M97 p. 228: #214(@101,102,103)

    def _set_nplc(self, argument):
        given, channels = self._arguments(argument)
        cycles = self._number(given[0]) if given else 1.0
        if cycles not in (0.02, 0.2, 1, 2, 10, 20, 100, 200):  # no source in the pages at hand
            raise ScpiError(-222)
        for channel in channels if channels is not None else self.scan:
            self.nplc[str(channel)] = cycles

    def _field(self, name, argument):
        word = (argument or "").upper()
        if word not in ("ON", "OFF", "0", "1"):
            raise ScpiError(-109 if not word else -141)
        on = word in ("ON", "1")
        self.fields = [each for each in FIELDS if (on if each == name else each in self.fields)]

    def _set_source(self, argument):
        word = (argument or "").upper()
        if word[:3] not in ("BUS", "IMM", "EXT", "ALA", "TIM"):  # M97 p. 228
            raise ScpiError(-141)
        self.source = word[:3]

    def _set_count(self, argument):
        self.count = int(self._number(argument or "x"))

    def _read(self, argument):
        """M97 p. 78: starts a scan, and sends the readings to the output buffer."""
        if argument is not None:
            raise ScpiError(-108)
        if not self.scan:
            raise ScpiError(-221)  # no source: which error an empty scan list is
        if self.source != "IMM":
            raise ScpiError(-221)  # no source: READ? waits for another trigger, which never comes here
        self._busy = [list(self.scan), 0.0, []]
        return None

    def _reset(self, argument):
        self.scan, self.ranges, self.nplc, self.fields = [], {}, {}, []
        self.source, self.count = "IMM", 1

    def _clear(self, argument):
        self.errors = []  # M97 p. 268

    def _error(self, code, now):
        self.tell(now, "error", code)
        if len(self.errors) < QUEUE[self.model]:
            self.errors = self.errors + [code]

    def _next_error(self, argument):
        if not self.errors:
            return '+0,"No error"'  # E1441
        code, *self.errors = self.errors
        return f'{code:+d},"{TEXTS.get(code, "Error")}"'


DOUBLE = ScpiLogger
