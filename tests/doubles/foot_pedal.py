"""Foot pedals: X-keys of 05f3:0268, X-keys XK-3 of 05f3:0438, VEC Infinity of 05f3:00ff.

Sources, named by their letters at the lines below:
  SDK    P.I. Engineering's X-keys SDK 2.1.0, data reports of the foot pedal (PID 0268h) and of the XK-3 (PID 0438h)
  XK     github SuperFlyTV/xkeys: products.ts (XK3FOOT), xkeys.ts (how a report is read through node-hid)
  VEC    public notes on the Infinity and AltoEdge pedals, version 14, with the HID descriptor of both:
         05 0C 09 03 A1 01 05 09 19 01 29 03 15 00 25 01 35 00 45 01 65 00 55 00 75 01 95 03 81 02 95 0D 81 03 C1 00
  KARA   Karabiner-Elements' documentation: left 1, middle 2, right 4
SPDX-License-Identifier: Apache-2.0
"""

from double import HidDouble, Refused

PRODUCTS = {"xkeys_0268": 0x0268, "xk3_0438": 0x0438, "vec": 0x00FF}  # SDK, SDK, VEC


class FootPedal(HidDouble):
    """Three pedals under a foot."""

    OPTIONS = {
        **HidDouble.OPTIONS,
        "model": "xk3_0438",
        # SDK: a report has 19 bytes, the first one the constant 0. no source: whether that byte is on the wire, or is
        # the report number 0 that Windows puts before a report without an id; then Linux sees 18 bytes.
        "constant": True,
        "repeats": 0,  # further copies of each report, as a hub that is in trouble or a bouncing contact makes
    }
    STATE = ("left", "middle", "right", "program_switch", "unit_id", "green", "red")
    VENDOR = 0x05F3  # SDK, VEC

    def __init__(self, **options):
        self.left = self.middle = self.right = False
        self.program_switch = False  # up
        self.unit_id = 0
        super().__init__(**options)
        if self.model not in PRODUCTS:
            raise Refused(f"no model '{self.model}'; there are {', '.join(PRODUCTS)}")
        self._said = self._pedals()

    @property
    def PRODUCT(self):  # noqa: N802  the name is the frame's
        """Product id."""
        return PRODUCTS[self.model]

    def start(self, now):
        """Power-up: no report until something changes; the unit id stays (SDK)."""
        self._begun = now
        self.put(now, green=False, red=False)

    def _pedals(self):
        return (self.left, self.middle, self.right, self.program_switch)

    def arranged(self, now):
        """A foot has moved: one report for the new state."""
        if self._pedals() == self._said:
            return
        self._said = self._pedals()
        for _ in range(1 + self.repeats):
            self.report(self._report(now), now)

    def _report(self, now, generated=False):
        pressed = self.left | self.middle << 1 | self.right << 2
        if self.model == "vec":
            # VEC: three one-bit buttons and 13 bits of padding, no report id: two bytes
            return bytes([pressed, 0])
        if self.model == "xkeys_0268":
            # SDK: constant 0; bit 2 left, bit 3 middle, bit 4 right (bits are counted from 1); bytes 3 to 17 reserved;
            # unit id; program switch: bit 4 is 1 when it is up, bit 5 is 1
            report = bytearray(19)
            report[1], report[17] = pressed << 1, self.unit_id
            report[18] = 0x10 | (0x08 if self.program_switch else 0)
            return bytes(report if self.constant else report[1:])
        # SDK: 33 bytes with the constant 0 of Windows. XK reads through hidraw: unit id, type (bit 0 program switch,
        # bit 1 answer to Generate Data), pedals as bit 2, 3, 4 counted from 1, time stamp of four bytes from byte 18,
        # high byte first, in ms since it was plugged in
        report = bytearray(32)
        report[0], report[1], report[2] = self.unit_id, self.program_switch | generated << 1, pressed << 1
        report[18:22] = (int((now - self._begun) * 1e3) & 0xFFFFFFFF).to_bytes(4, "big")
        return bytes(report)

    def report_out(self, report, now):
        """Lights, unit id, and Generate Data."""
        if self.model == "xkeys_0268" and len(report) >= 9:
            if report[1:3] == b"\x89\x89" and report[8] == 16:
                self.put(now, unit_id=report[7])  # SDK, set unit id: 0 137 137 0 0 0 0 value 16
                return len(report)
            if not any(report[:8]):
                self.put(now, green=bool(report[8] & 0x40), red=bool(report[8] & 0x80))  # SDK, set LEDs: bit 7, bit 8
                return len(report)
        if self.model == "xk3_0438" and report[:2] == b"\0\xb1":
            self.report(self._report(now, generated=True), now)  # no source at hand for 177 but XK's word genData
            return len(report)
        return super().report_out(report, now)


DOUBLE = FootPedal
