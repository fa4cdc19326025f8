"""An IIDC (DCAM) camera, as a map of registers: Basler A620f and A602f, which have no absolute control; on demand one that has.

Offsets are counted in bytes from FFFF F0F0 0000. Bit 0 is the most significant one, as in the manuals.

Sources, named by their letters at the lines below:
  A620  Basler A620f user's manual, pages 4-15, 4-17, 4-19, 4-23 to 4-26, 4-29, 4-32, 4-34
  A600  Basler A600f user's manual (A601f, A602f), pages 3-6, 3-7, 3-9, 4-2, 4-16, 4-21, 4-24
  A102  Basler A102f user's manual, pages 4-9, 4-19, 4-24 (what the family has in common)
  LIB   libdc1394 (github ShaperTools/libdc1394) dc1394/offsets.h, control.c: which bit the host reads for what
  F     the project's fact sheet iidc_1394 (IIDC 1.31, TA document 2003017)
SPDX-License-Identifier: Apache-2.0
"""

import math
import struct

from double import Refused, RegisterDouble

SHUTTER, GAIN = 0x81C, 0x820
SHUTTER_UNIT = 20e-6  # A620 4-24
# F, LIB: where absolute values stand is the camera's choice, told in quadlets from FFFF F000 0000; minimum, maximum, value.
ABSOLUTE = {SHUTTER: 0x1100000, GAIN: 0x1100010}
FORMAT_7 = 0x1000000  # A620 4-29: the registers of format 7, mode 0 stand at FFFF F1F0 0000
MODELS = {
    # width, height, step of width, gain max and default, factor at the greatest gain, brightness max and default
    "a620f": (1280, 1024, 4, 740, 150, 10.23, 255, 8),  # A620 4-29, 4-17, 4-25 (20.2 dB), 4-15, 4-23
    "a602f": (656, 491, 1, 255, 28, 4.0, 1023, 16),  # A600 4-16, 4-24 (12 dB, 4x), 4-21
}


def bit(number):
    """The mask of a bit counted from the most significant one."""
    return 1 << (31 - number)


class Iidc(RegisterDouble):
    """The camera, with even light on its sensor."""

    OPTIONS = {
        **RegisterDouble.OPTIONS,
        "model": "a620f",
        # A620 4-26 says the trigger feature cannot be switched off, A600 3-6 that On_Off enables it, A102 4-9 that it is
        # off by default. no source that decides: it can be switched here, and is off.
        "trigger_fixed_on": False,
        "one_shot_delay": 0.001,  # A600 3-7: "there will be some delay" after a one-shot command; no source for how long
        "pixels": True,  # images with their bytes
        # A camera as the Grasshopper, whose shutter and gain take s and dB (F). Its ranges here are the A620f's.
        "absolute": False,
        # Shutter and gain choose for themselves at power-up (F: bit 6 of the inquiry, bit 7 of the value).
        "automatic": False,
        # LIB format7.c: from IIDC 1.30 on a host sets bit 1 of 07C and reads it until it is clear; bit 8 says that the area
        # cannot be. A camera without it reads 0. no source that an A620f has it.
        "handshake": True,
    }
    STATE = (
        "registers", "transmitting", "images_left", "light", "exposures", "lost_triggers", "resets",
    )

    def __init__(self, **options):
        self.light = 20000.0  # grey levels a second at a gain of 1
        self.exposures = self.lost_triggers = self.resets = 0
        super().__init__(**options)
        if self.model not in MODELS:
            raise Refused(f"no model '{self.model}'; there are {', '.join(MODELS)}")

    def start(self, now):
        """Power-up: every register at its default."""
        width, height, _, _, gain, _, _, brightness = MODELS[self.model]
        self.registers = {
            0x600: 0, 0x604: 0, 0x608: 7 << 29,  # no source: which format is the default; here format 7
            0x60C: 0, 0x610: bit(0), 0x614: 0, 0x618: 0, 0x61C: 0, 0x62C: 0,
            0x800: brightness, 0x81C: 200, 0x820: gain,  # A620 4-23, 4-24 (default 200), 4-25
            0x830: bit(7) | 1 << 16 | (bit(6) if self.trigger_fixed_on else 0),  # A620 4-26: polarity 1, mode 1, port 0
            FORMAT_7 + 0x08: 0, FORMAT_7 + 0x0C: width << 16 | height, FORMAT_7 + 0x10: 0,
            FORMAT_7 + 0x44: 4096 << 16,
        }
        self._pending = []  # (arrival, number, start, width, height, shutter, gain, brightness)
        self._exposing_until = now
        self.transmitting, self.images_left = False, 0
        self._next_exposure = None
        self._area_refused = False
        # The bits of a feature's value that a host may change: absolute control, automatic.
        self._control = {offset: bit(7) if self.automatic else 0 for offset in (SHUTTER, GAIN)}

    # -- registers -----------------------------------------------------------------------------------------

    def read(self, offset, now):
        """A600 4-2: a register that does not exist reads 0."""
        self.advance(now)
        width, height, unit, gain_max, _, _, brightness_max, _ = MODELS[self.model]
        fixed = {
            0x100: bit(0) | bit(7),  # F: formats 0 and 7
            0x180: bit(5),  # F: format 0, mode 5 is 640x480 Mono 8; no source that an A620f has it
            0x200 + 4 * 5: bit(0) | bit(1) | bit(2) | bit(3) | bit(4) | bit(5),  # F: rates 1.875 * 2^n up to 60
            0x2E0: 0x1F00000 // 4,  # LIB, F: in quadlets from FFFF F000 0000; A620 4-29
            0x19C: bit(0),  # F: format 7, mode 0
            # LIB control.c: bit 19 one shot, bit 20 multi shot; no memory channels
            0x400: bit(19) | bit(20),
            0x404: bit(0) | bit(7) | bit(8) | bit(12),  # F: brightness, shutter, gain, trigger
            # A620 4-15, 4-17: presence, no absolute value, no one push, read out, no on/off, no auto, manual, min, max
            0x500: bit(0) | bit(4) | bit(7) | brightness_max,
            0x51C: bit(0) | bit(4) | bit(7) | 1 << 12 | 4095,  # A620 4-24: 1 to 4095
            0x520: bit(0) | bit(4) | bit(7) | gain_max,
            # LIB: readout, on/off, polarity; ports 0 to 3 from bit 8, software bit 15; modes 0 and 1 from bit 16
            0x530: bit(0) | bit(4) | bit(5) | bit(6) | bit(8) | bit(9) | bit(10) | bit(11) | bit(15) | bit(16) | bit(17),
            0x630: 8 << 24,  # A102 4-19: 8 bits a pixel
            FORMAT_7 + 0x00: width << 16 | height,  # A620 4-29
            FORMAT_7 + 0x04: unit << 16 | 1,
            FORMAT_7 + 0x14: bit(0),  # A600 4-16: Mono 8 is ID 0
            FORMAT_7 + 0x34: self._size()[0] * self._size()[1],  # A620 4-32
            FORMAT_7 + 0x38: 0, FORMAT_7 + 0x3C: self._size()[0] * self._size()[1],
            FORMAT_7 + 0x40: 4 << 16 | 4096,  # A620 4-32: step 4, most 4096
            FORMAT_7 + 0x48: self._packets(), FORMAT_7 + 0x4C: unit << 16 | 1,
            FORMAT_7 + 0x50: struct.unpack(">I", struct.pack(">f", self._period()))[0],  # A620 4-34: seconds, IEEE 754
            FORMAT_7 + 0x54: 8 << 24,
            FORMAT_7 + 0x7C: (bit(0) | (bit(8) if self._area_refused else 0)) if self.handshake else 0,
        }
        if offset in (0x51C, 0x520):  # F: bit 1 absolute, bit 6 automatic
            return fixed[offset] | (bit(1) if self.absolute else 0) | (bit(6) if self.automatic else 0)
        if offset in fixed:
            return fixed[offset]
        if self.absolute and (found := self._absolute(offset)) is not None:
            return found
        value = self.registers.get(offset, 0)
        if offset in (0x800, 0x81C, 0x820):
            value |= bit(0) | bit(6) | self._control.get(offset, 0)  # A620 4-23: present, no absolute control, on, manual
        if offset == 0x830:
            value |= bit(0)
        return value

    def write(self, offset, value, now):
        """A600 4-2: writing a register that does not exist has no effect."""
        self.advance(now)
        value &= 0xFFFFFFFF
        self.tell(now, "write", [offset, value])
        if offset == 0x000 and value & bit(0):  # F: INITIALIZE
            self.resets += 1
            self.start(now)
        elif offset in (0x800, 0x81C, 0x820):
            inquiry = self.read(0x500 + offset - 0x800, now)
            # no source for a value beyond: the nearest that is allowed. Read-only fields are left as they are.
            number = min(max(value & 0xFFF, inquiry >> 12 & 0xFFF), inquiry & 0xFFF)
            if offset in self._control:
                self._control[offset] = value & ((bit(1) if self.absolute else 0) | (bit(7) if self.automatic else 0))
                if self._control[offset]:
                    return  # F: the other control, or the camera itself, has the value
            self.registers[offset] = number
        elif offset == 0x830:
            # A620 4-26: on, polarity, source, mode; presence and absolute control are read only
            on = bit(6) if self.trigger_fixed_on else value & bit(6)
            self.registers[offset] = on | value & (bit(7) | 0xE00000 | 0xF0000)
        elif offset == 0x614:
            self._continuous(bool(value & bit(0)), now)
        elif offset == 0x61C:
            self._shots(value, now)
        elif offset == 0x62C:
            self._software_trigger(value, now)
        elif offset in (FORMAT_7 + 0x08, FORMAT_7 + 0x0C):
            self._area(offset, value, now)
        elif offset == FORMAT_7 + 0x44:
            packet = min(max(value >> 16 & ~3, 4), 4096)  # A620 4-32
            self.registers[offset] = packet << 16
        elif offset == FORMAT_7 + 0x7C:
            pass  # LIB: bit 1 clears itself; here at once
        elif offset in self.registers:
            self.registers[offset] = value
        elif self.absolute and offset - 8 in ABSOLUTE.values():
            self._set_absolute(offset - 8, value)
        else:
            self.tell(now, "no such register", offset)

    def _in_units(self, feature, counts):
        """Seconds of a shutter, dB of a gain."""
        if feature == SHUTTER:
            return counts * SHUTTER_UNIT
        _, _, _, gain_max, _, factor, _, _ = MODELS[self.model]
        return 20 * math.log10(1 + counts * (factor - 1) / gain_max)

    def _absolute(self, offset):
        """F: where the values stand, from 700 on; least, most and current value, IEEE 754."""
        for feature, place in ABSOLUTE.items():
            if offset == feature - 0x100:
                return (0xF00000 + place) // 4
            if offset in (place, place + 4, place + 8):
                limits = self.read(feature - 0x300, self.now)
                counts = (limits >> 12 & 0xFFF, limits & 0xFFF, self.registers[feature])[(offset - place) // 4]
                return struct.unpack(">I", struct.pack(">f", self._in_units(feature, counts)))[0]
        return None

    def _set_absolute(self, place, value):
        """The nearest that the camera can; without effect unless absolute control is on."""
        feature = next(each for each, where in ABSOLUTE.items() if where == place)
        if not self._control[feature] & bit(1) or self._control[feature] & bit(7):
            return
        (wanted,) = struct.unpack(">f", struct.pack(">I", value))
        limits = self.read(feature - 0x300, self.now)
        counts = range(limits >> 12 & 0xFFF, (limits & 0xFFF) + 1)
        self.registers[feature] = min(counts, key=lambda each: abs(self._in_units(feature, each) - wanted))

    def _area(self, offset, value, now):
        width, height, unit = MODELS[self.model][:3]
        high, low = value >> 16, value & 0xFFFF
        wide, tall = self._size() if offset == FORMAT_7 + 0x08 else (high, low)
        left, top = divmod(self.registers[FORMAT_7 + 0x08], 1 << 16) if offset != FORMAT_7 + 0x08 else (high, low)
        # F of IIDC: the area has to lie in the sensor; no source for what the camera does with another: it keeps the old
        if high % unit or left + wide > width or top + tall > height or (offset == FORMAT_7 + 0x0C and 0 in (high, low)):
            self.tell(now, "refused area", [high, low])
            self._area_refused = True
            return
        self._area_refused = False
        self.registers[offset] = value

    # -- images --------------------------------------------------------------------------------------------

    @property
    def exposure(self):
        """Seconds; A620 4-24: value x 20 us. By itself: no source; here for a gray of 128 at a gain of 1."""
        if self._control[SHUTTER] & bit(7):
            return min(max(128 / max(self.light, 1e-3), SHUTTER_UNIT), 4095 * SHUTTER_UNIT)
        return self.registers[SHUTTER] * SHUTTER_UNIT

    def _format(self):
        return self.registers[0x608] >> 29

    def _size(self):
        if self._format() == 7:
            value = self.registers[FORMAT_7 + 0x0C]
            return value >> 16, value & 0xFFFF
        return 640, 480  # F: format 0, mode 5

    def _packets(self):
        width, height = self._size()
        return -(-width * height // max(self.registers[FORMAT_7 + 0x44] >> 16, 4))

    def _period(self):
        """Seconds between free-running images. F: 125 us a packet; rates of format 0 are 1.875 * 2^n."""
        if self._format() == 7:
            return max(self._packets() * 125e-6, self.exposure)
        rate = 1.875 * 2 ** min(self.registers[0x600] >> 29, 5)
        return max(1 / rate, self.exposure)

    def _triggered(self):
        return bool(self.registers[0x830] & bit(6))

    def _continuous(self, on, now):
        self.registers[0x614] = bit(0) if on else 0
        self.transmitting = on
        self.tell(now, "transmitting", on)
        self._next_exposure = max(now, self._exposing_until) if on and not self._triggered() else None

    def _shots(self, value, now):
        if self.transmitting:
            self.tell(now, "one shot while transmitting", value)  # F: for a camera that does not transmit
            return
        if value & bit(0):
            self.images_left = 1
        elif value & bit(1):
            self.images_left = value & 0xFFFF  # LIB: 0x40000000 | count
        else:
            self.images_left = 0
        self.registers[0x61C] = value if self.images_left else 0
        self._next_exposure = now + self.one_shot_delay if self.images_left and not self._triggered() else None

    def _software_trigger(self, value, now):
        """A600 3-6: needs trigger on, source 7, mode 0, and continuous shot; the register clears itself."""
        trigger = self.registers[0x830]
        if not value & bit(0):
            return
        if not (trigger & bit(6) and trigger >> 21 & 7 == 7 and trigger >> 16 & 0xF == 0 and self.transmitting):
            self.tell(now, "trigger without effect", trigger)
            self.lost_triggers += 1
            return
        self._trigger(now)

    def external_trigger(self, port, now):
        """A pulse on an input port of the camera (mode 0; level mode takes the pulse as the exposure)."""
        self.advance(now)
        trigger = self.registers[0x830]
        if trigger & bit(6) and trigger >> 21 & 7 == port and (self.transmitting or self.images_left):
            self._trigger(now)
        else:
            self.lost_triggers += 1

    def _trigger(self, now):
        if now < self._exposing_until:  # A600 3-7: wait until TrigRdy goes high
            self.lost_triggers += 1
            self.tell(now, "trigger while busy", now)
            return
        self._expose(now)

    def _expose(self, when):
        width, height = self._size()
        self.exposures += 1
        transfer = self._packets() * 125e-6 if self._format() == 7 else self._period()
        arrival = when + self.exposure + transfer
        self._exposing_until = when + max(self.exposure, self._period())
        self._pending.append((arrival, self.exposures, when, width, height, self._level()))
        if self.images_left:
            self.images_left -= 1
            if not self.images_left:
                self.registers[0x61C] = 0  # F: clears itself

    def _level(self):
        """The grey level: A620 4-23 (four of brightness are one level of 8 bits), 4-25 (0 is 1x, 740 is 20.2 dB)."""
        _, _, _, gain_max, _, factor, _, _ = MODELS[self.model]
        # A620: 125 is 8.2 dB and 740 is 20.2 dB: the factor grows evenly with the value
        gain = 1 + self.registers[0x820] * (factor - 1) / gain_max
        return min(max(round(self.registers[0x800] / 4 + self.light * self.exposure * gain), 0), 255)

    def next_event(self):
        """The next exposure or arrival."""
        times = [each[0] for each in self._pending[:1]]
        if self._next_exposure is not None:
            times.append(self._next_exposure)
        return min(times, default=None)

    def advance(self, now):
        """Exposes what is due."""
        while self._next_exposure is not None and self._next_exposure <= now:
            when = self._next_exposure
            self._expose(when)
            going = (self.transmitting or self.images_left) and not self._triggered()
            self._next_exposure = when + self._period() if going else None
        super().advance(now)

    def images(self, now):
        """Those that have arrived."""
        self.advance(now)
        told = []
        while self._pending and self._pending[0][0] <= now:
            arrival, number, start, width, height, level = self._pending.pop(0)
            data = bytes([level]) * (width * height) if self.pixels else bytes([level])
            told.append((arrival, number, start, width, height, data))
        return told


DOUBLE = Iidc
