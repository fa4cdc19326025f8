"""What a camera's sensor sees, and how its values lie in a picture's bytes.

A test can compute each pixel from the definitions here. In sensor coordinates (x, y) the light is, as a fraction of
`ambient` (full scales a second at a gain of 0 dB): (x + 0.5) / width where bit 1 of y is 0, else (y + 0.5) / height;
times the colour of the pixel's filter on a colour sensor. The value in 12 bits is

  floor(black + 4096 * light * exposure * gain), at most 4095, then 4095 * (value / 4095) ** gamma, rounded.

A judge allows one count, for products that lie on a whole number. Formats of fewer bits take its upper bits, Mono16
has it in its upper 12 bits. On top lie, in this order: the lamp, a square that is dark but for the lamp's light; the
dot, 8x8 at full scale, which crosses the sensor once in `dot_period` of device time; and the strip, in the picture's
first four rows, 32 cells of 4x4 pixels, black or full scale: the device time at the start of the exposure in
microseconds, its lower 32 bits, highest bit first (pictures of 128x4 or more).

Sources:
  PFNC  pixel format numbers: Aravis src/arvenums.h and Wireshark packet-gvsp.c
  NI    the bits of Mono12Packed: FLIR's ImageFormatControl page as ADGenICam quotes it, and a table in public code:
        byte 0 = A 11..4, byte 1 = B 3..0 | A 3..0, byte 2 = B 11..4
SPDX-License-Identifier: Apache-2.0
"""

from array import array
import sys

FULL = 4095
STRIP_CELL, STRIP_BITS, DOT = 4, 32, 8
COLORS = {"R": 1.0, "G": 0.6, "B": 0.3}  # the scene's colour under white balance ratios of 1

# PFNC; name: (number, kind of packing, filter at the sensor's (0, 0), (1, 0), (0, 1), (1, 1))
FORMATS = {
    "Mono8": (0x01080001, "8", None),
    "Mono10": (0x01100003, "10", None),
    "Mono12": (0x01100005, "12", None),
    "Mono16": (0x01100007, "16", None),
    "Mono10p": (0x010A0046, "10p", None),
    "Mono12p": (0x010C0047, "12p", None),
    "Mono12Packed": (0x010C0006, "12packed", None),
    "BayerGR8": (0x01080008, "8", "GRBG"),
    "BayerRG8": (0x01080009, "8", "RGGB"),
    "BayerGB8": (0x0108000A, "8", "GBRG"),
    "BayerBG8": (0x0108000B, "8", "BGGR"),
    "BayerGR12": (0x01100010, "12", "GRBG"),
    "BayerRG12": (0x01100011, "12", "RGGB"),
    "BayerGB12": (0x01100012, "12", "GBRG"),
    "BayerBG12": (0x01100013, "12", "BGGR"),
}
NUMBERS = {number: name for name, (number, _, _) in FORMATS.items()}


def bits(format_name):
    """Bits a pixel takes: the number's second byte. PFNC"""
    return FORMATS[format_name][0] >> 16 & 0xFF


def _words(values):
    words = array("H", values)
    if sys.byteorder == "big":
        words.byteswap()
    return words.tobytes()  # little-endian, right-aligned; no source that all makers align so


def _pack_12_packed(values):
    out = bytearray()
    for a, b in zip(values[::2], values[1::2]):
        out += bytes((a >> 4, (b & 15) << 4 | a & 15, b >> 4))  # NI
    return bytes(out)


def _pack_dense(values, width):
    """Bits one behind the other, low bits first, in groups of four pixels."""
    out = bytearray()
    for start in range(0, len(values), 4):
        whole = 0
        for index, value in enumerate(values[start:start + 4]):
            whole |= value << (index * width)
        out += whole.to_bytes(width // 2, "little")
    return bytes(out)


PACK = {
    "8": lambda values: bytes([v >> 4 for v in values]),
    "10": lambda values: _words([v >> 2 for v in values]),
    "12": _words,
    "16": lambda values: _words([v << 4 for v in values]),
    "10p": lambda values: _pack_dense([v >> 2 for v in values], 10),
    "12p": lambda values: _pack_dense(values, 12),
    "12packed": _pack_12_packed,
}


class View:
    """The region and format of a picture: which sensor pixel each of its pixels is."""

    def __init__(self, sensor, region, format_name, flips=(False, False)):
        self.sensor, self.region, self.format, self.flips = sensor, region, format_name, flips
        x, y, width, height = region
        self.width, self.height = width, height
        # no source: the region is taken in the flipped picture
        self.columns = [sensor[0] - 1 - each if flips[0] else each for each in range(x, x + width)]
        self.rows = [sensor[1] - 1 - each if flips[1] else each for each in range(y, y + height)]
        _, kind, self.filters = FORMATS[format_name]
        self.pack = PACK[kind]
        self.pitch = width * bits(format_name) // 8
        self.group = 4 if kind[-1] in "pd" else 1  # pixels that share bytes

    def key(self):
        """What tells two views apart."""
        return self.sensor, self.region, self.format, self.flips

    def filter(self, x, y):
        """The letter of the filter on a sensor pixel, or None."""
        return self.filters[(y & 1) * 2 + (x & 1)] if self.filters else None

    def columns_of(self, left, right):
        """The picture's columns that show these sensor columns, as a range [first, end)."""
        return _shown(self.columns, self.flips[0], left, right)

    def rows_of(self, top, bottom):
        """The picture's rows that show these sensor rows, as a range [first, end)."""
        return _shown(self.rows, self.flips[1], top, bottom)

    def true_format(self):
        """The format's name with the phase that the picture's own first pixels have."""
        if not self.filters:
            return self.format
        first = "".join(self.filter(x, self.rows[0]) for x in self.columns[:2])
        return "Bayer" + first + self.format[7:]


def _shown(axis, flipped, low, high):
    """Where the sensor pixels [low, high) lie on an axis of a picture."""
    if flipped:
        first, end = axis[0] - high + 1, axis[0] - low + 1
    else:
        first, end = low - axis[0], high - axis[0]
    return max(first, 0), min(end, len(axis))


class Look:
    """The settings that turn light into values."""

    def __init__(self, ambient, exposure, gain, black, gamma, balance=(1.0, 1.0, 1.0)):
        self.ambient, self.exposure, self.gain, self.black, self.gamma = ambient, exposure, gain, black, gamma
        self.balance = balance

    def key(self):
        """What tells two looks apart."""
        return self.ambient, self.exposure, self.gain, self.black, self.gamma, self.balance

    def value(self, fraction):
        """The 12-bit value of a pixel that got this fraction of full scale."""
        value = min(max(int(self.black + 4096.0 * fraction), 0), FULL)
        return value if self.gamma == 1.0 else round(FULL * (value / FULL) ** self.gamma)

    def weight(self, letter):
        """Ambient light on a pixel with this filter, in fractions of full scale."""
        whole = self.ambient * self.exposure * self.gain
        return whole if letter is None else whole * COLORS[letter] * self.balance["RGB".index(letter)]


class Painter:
    """Makes pictures; keeps the last background, so that only what moves is painted anew."""

    def __init__(self):
        self._key = None
        self._background = b""
        self._ramps = {}

    def picture(self, view, look, lamp, dot, strip):
        """One picture's bytes. lamp: (left, top, side, fraction); dot: (left, top); strip: a number; each or None."""
        key = (view.key(), look.key(), lamp and lamp[:3])
        if key != self._key:
            self._key, self._ramps = key, {}
            self._background = self._make_background(view, look, lamp)
        image = bytearray(self._background)
        if lamp and lamp[3] > 0:
            left, top, side, fraction = lamp
            self._square(image, view, look, (left, top, side, side), look.value(fraction))
        if dot:
            self._square(image, view, look, (dot[0], dot[1], DOT, DOT), FULL)
        if strip is not None and view.width >= STRIP_CELL * STRIP_BITS and view.height >= STRIP_CELL:
            self._strip(image, view, strip)
        return image

    def row(self, view, look, row):
        """The background's 12-bit values of one row of the picture."""
        y = view.rows[row]
        if y & 2:
            pair = [look.value(look.weight(view.filter(x, y)) * (y + 0.5) / view.sensor[1])
                    for x in view.columns[:2]]
            return pair * (view.width // 2)
        parity = y & 1 if view.filters else 0
        if parity not in self._ramps:
            weights = [look.weight(view.filter(x, y)) / view.sensor[0] for x in (0, 1)]
            self._ramps[parity] = [look.value(weights[x & 1] * (x + 0.5)) for x in view.columns]
        return self._ramps[parity]

    def _make_background(self, view, look, lamp):
        ramps, rows = {}, []
        for row in range(view.height):
            y = view.rows[row]
            if y & 2:
                four = self.row(view, look, row)[:4]
                rows.append(view.pack(four) * (view.width // 4))
                continue
            parity = y & 1 if view.filters else 0
            if parity not in ramps:
                ramps[parity] = view.pack(self.row(view, look, row))
            rows.append(ramps[parity])
        image = bytearray(b"".join(rows))
        if lamp:
            self._square(image, view, look, (*lamp[:2], lamp[2], lamp[2]), look.value(0.0))
        return bytes(image)

    def _square(self, image, view, look, place, value):
        """Fills a rectangle (left, top, width, height) of the sensor."""
        left, top, wide, tall = place
        first, end = view.columns_of(left, left + wide)
        if first >= end:
            return
        start, stop = first // view.group * view.group, -(-end // view.group) * view.group
        at, size = start * view.pitch // view.width, (stop - start) * view.pitch // view.width
        plain = start == first and stop == end
        filled = view.pack([value] * (stop - start)) if plain else None
        for row in range(*view.rows_of(top, top + tall)):
            if not plain:
                # What lies beside the rectangle in its groups is read back from the background.
                values = self.row(view, look, row)[start:stop]
                values[first - start:end - start] = [value] * (end - first)
                filled = view.pack(values)
            image[row * view.pitch + at:row * view.pitch + at + size] = filled

    def _strip(self, image, view, number):
        values = []
        for index in range(STRIP_BITS):
            values += [FULL if number >> (STRIP_BITS - 1 - index) & 1 else 0] * STRIP_CELL
        packed = view.pack(values)
        for row in range(STRIP_CELL):
            image[row * view.pitch:row * view.pitch + len(packed)] = packed


class Lamp:
    """A lamp that is switched from outside; remembers when it was lit, in seconds."""

    def __init__(self):
        self.lit = []  # [from, until or None]

    def switch(self, on, now):
        """Switches it."""
        burning = self.lit and self.lit[-1][1] is None
        if on and not burning:
            self.lit.append([now, None])
        elif not on and burning:
            self.lit[-1][1] = now
        del self.lit[:-1000]

    def flash(self, start, length):
        """Lights it for a while, now or later; flashes are ordered one after the other."""
        self.lit.append([start, start + length])
        del self.lit[:-1000]

    def overlap(self, start, end):
        """Seconds that it burnt between two times."""
        return sum(max(0.0, min(end, end if until is None else until) - max(start, since))
                   for since, until in self.lit)
