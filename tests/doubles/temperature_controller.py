"""Temperature controllers on Modbus: HCP TC038D and Pixsys ATR142.

Sources, named by their letters at the lines below:
  HCP  github pymeasure/pymeasure hcp/tc038d.py and its tests ("Communication from manual")
  PIX  Pixsys ATR142 user's manual, pages 21 and 28 (functions, words, EEPROM); ATR243, pages 25, 26, for what the pages
       of the ATR142 at hand do not show: addresses above 1007 are the ATR243's less one alarm (no source that they are)
  F    the project's fact sheet scripted_instruments, B 5
SPDX-License-Identifier: Apache-2.0
"""

import math

from double import Refused
from modbus import (DEVICE_FAILURE, DIAGNOSE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, READ_HOLDING, READ_INPUT, WRITE_MANY, WRITE_ONE,
                    Exceptional, ModbusDouble)

FUNCTIONS = {"tc038d": (READ_HOLDING, WRITE_ONE, DIAGNOSE, WRITE_MANY),  # HCP Functions
             "atr142": (READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY)}  # PIX
MOST = {"tc038d": 32, "atr142": 20}  # PIX: max 20 words; no source for the other
STORED_AFTER = 10.0  # s: PIX p. 28: set-points are stored with a delay of 10 s after the last modification
LIFE = 100000  # PIX p. 28: writing cycles of the EEPROM


def signed(word):
    """A word as two's complement."""
    return word - 0x10000 if word & 0x8000 else word


class TemperatureController(ModbusDouble):
    """The controller, its heater and what is heated: tau T' = T_end - T."""

    OPTIONS = {
        **ModbusDouble.OPTIONS,
        "model": "tc038d",
        "tau": 60.0,  # s
        # no source for the value of a broken sensor, F: "often a value, not an exception": or "exception"
        "broken_reads": "value",
    }
    STATE = ("temperature", "setpoint", "ambient", "broken", "power", "eeprom_writes", "lasting", "frames", "dropped",
             "heating", "hottest")

    def __init__(self, **options):
        self.lasting = None
        self.ambient = self.temperature = 22.0  # degC
        self.hottest = 400.0  # what the heater can reach
        self.broken = False  # the sensor
        self.heating = True
        self.power = 1.0
        self.eeprom_writes = 0
        super().__init__(**options)

    def start(self, now):
        """Power-up: set-points come from the EEPROM."""
        super().start(now)
        if self.model not in FUNCTIONS:
            raise Refused(f"no model '{self.model}'; there are {', '.join(FUNCTIONS)}")
        self.FUNCTIONS, self.MOST = FUNCTIONS[self.model], MOST[self.model]
        if self.lasting is None:
            self.lasting = {1001 + n: 0 for n in range(6)} if self.model == "atr142" else {0x106: 200, 0x10A: 0, 0x10C: 0}
        self._registers = dict(self.lasting)
        self._store_at = None
        self.now = now

    @property
    def setpoint(self):
        """degC."""
        return self._registers[1001 if self.model == "atr142" else 0x106] / 10

    # -- time ----------------------------------------------------------------------------------------------

    def next_event(self):
        """The end of a frame, or the storing of set-points."""
        times = [each for each in (super().next_event(), self._store_at) if each is not None]
        return min(times, default=None)

    def advance(self, now):
        """Heats and stores."""
        while (event := self.next_event()) is not None and event <= now:
            self._heat(event)
            if self._store_at is not None and self._store_at <= event:
                self._store_at = None
                self._store(event)
            super().advance(event)
        self._heat(now)
        super().advance(now)

    def _heat(self, now):
        span = max(0.0, now - self.now)
        aim = min(max(self.setpoint, self.ambient), self.hottest) if self.heating and not self.broken else self.ambient
        self.temperature = aim + (self.temperature - aim) * math.exp(-span / self.tau)
        self.power = 0.0 if aim == self.ambient else min(1.0, max(0.0, (aim - self.temperature) / 20 + 0.2))
        self.now = max(self.now, now)

    def _store(self, now):
        self.put(now, eeprom_writes=self.eeprom_writes + 1, lasting=dict(self._registers))
        if self.eeprom_writes > LIFE:
            self.tell(now, "EEPROM worn", self.eeprom_writes)

    # -- registers -----------------------------------------------------------------------------------------

    def _process(self):
        if self.broken:
            if self.broken_reads == "exception":
                raise Exceptional(DEVICE_FAILURE)
            return 32767 if self.model == "atr142" else 0x7FFFFFFF
        return round(self.temperature * 10)

    def check_range(self, address, count):
        """HCP: four-byte mode: two registers a value, at even addresses."""
        if self.model == "tc038d" and self.strict and (address % 2 or count % 2):
            raise Exceptional(ILLEGAL_VALUE)  # no source for which exception

    def read_word(self, address, function, now):
        """One register."""
        return self._read_atr142(address) if self.model == "atr142" else self._read_tc038d(address)

    def _read_tc038d(self, address):
        even = address & ~1
        if even == 0x0000:  # HCP: temperature
            value = self._process()
        elif even in self._registers:
            value = self._registers[even]
        else:
            raise Exceptional(ILLEGAL_ADDRESS)  # HCP: wrong start address
        return value >> 16 if address == even else value  # HCP: big-endian, the high word first

    def _read_atr142(self, address):
        if address in self._registers:
            return self._registers[address]
        fixed = {0: 142, 1: 100, 5: self.unit, 6: 1,  # PIX p. 28; no source for the numbers of type and versions
                 1000: self._process, 1007: lambda: self._registers[1001],
                 1008: lambda: int(self.power > 0), 1009: lambda: round(self.power * 10000),
                 1013: lambda: 8 if self.broken else 0,  # error flags, bit 3: process error
                 1015: lambda: int(self.heating)}
        if address not in fixed:
            raise Exceptional(ILLEGAL_ADDRESS)
        value = fixed[address]
        return value() if callable(value) else value

    def write_words(self, address, words, now):
        """Writes; a part that cannot be written leaves all as it was."""
        if self.model == "atr142":
            self._write_atr142(address, words, now)
        else:
            self._write_tc038d(address, words, now)

    def _write_tc038d(self, address, words, now):
        if len(words) % 2:
            words = [0, *words]  # a single word with strict off: the low one
            address -= 1
        values = {}
        for place in range(0, len(words), 2):
            if address + place not in self._registers:
                raise Exceptional(ILLEGAL_ADDRESS)
            value = words[place] << 16 | words[place + 1]
            value -= 1 << 32 if value & 1 << 31 else 0
            if self.strict and address + place == 0x106 and not -2000 <= value <= 13700:
                raise Exceptional(ILLEGAL_VALUE)  # HCP: variable data error; no source for the limits: type K's
            values[address + place] = value
        self._registers.update(values)
        self.tell(now, "written", {hex(each): value for each, value in values.items()})

    def _write_atr142(self, address, words, now):
        values = dict(zip(range(address, address + len(words)), words))
        for each, value in values.items():
            if each not in self._registers and each != 1015:
                raise Exceptional(ILLEGAL_ADDRESS)  # PIX: the others are read only; no source for which exception
            if self.strict and each == 1001 and not -2000 <= signed(value) <= 13700:
                raise Exceptional(ILLEGAL_VALUE)  # no source for the limits
        for each, value in values.items():
            if each == 1015:
                self.put(now, heating=bool(value))
            else:
                self._registers[each] = signed(value)
                self._store_at = now + STORED_AFTER
        self.tell(now, "written", {str(each): signed(value) for each, value in values.items()})


DOUBLE = TemperatureController
