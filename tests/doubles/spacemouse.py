"""A 3Dconnexion space mouse: the Navigator family (two reports) and the wireless family (one report).

Sources, named by their letters at the lines below:
  NAV  github AndunHH/spacemouse SpaceNavigator.md: HID descriptor, reports and times seen with Wireshark
  WLS  the same, SpaceMouseWireless.md
  SPN  github FreeSpacenav/spacenavd src/dev.c: product ids
SPDX-License-Identifier: Apache-2.0
"""

import struct

from double import STALL, HidDouble, Refused

# SPN: vendor and product ids; the form of their reports by NAV, WLS (no source for the form of the others).
MODELS = {
    "navigator": (0x046D, 0xC626, False), "compact": (0x256F, 0xC635, False), "wireless": (0x256F, 0xC62E, True),
    "wireless_receiver": (0x256F, 0xC62F, True), "pro_wireless": (0x256F, 0xC631, True),
}
# NAV: feature reports and the bytes behind their ids; WLS adds 19h and 1Ah. no source for what they hold: zeros.
FEATURES = {5: 1, 6: 1, 7: 1, 8: 7, 9: 7, 0x0A: 7, 0x0B: 1, 0x13: 1}


class Spacemouse(HidDouble):
    """The cap, two keys and a light."""

    OPTIONS = {
        **HidDouble.OPTIONS,
        "model": "navigator",
        "zeros": 3,  # NAV: after the last package with non-zero data three double packages; 0 loses them all
        "period": 0.0,  # seconds between reports; 0: 8 ms alternating (NAV), or 16 ms (WLS)
    }
    STATE = ("deflection", "keys", "led", "battery", "frozen", "sent")

    def __init__(self, **options):
        self.deflection = [0] * 6  # x, y, z, rx, ry, rz as reported
        self.keys = 0
        self.frozen = False  # sends nothing any more, as when the radio is lost
        super().__init__(**options)
        if self.model not in MODELS:
            raise Refused(f"no model '{self.model}'; there are {', '.join(MODELS)}")

    @property
    def VENDOR(self):  # noqa: N802  the name is the frame's
        """Vendor id."""
        return MODELS[self.model][0]

    @property
    def PRODUCT(self):  # noqa: N802
        """Product id."""
        return MODELS[self.model][1]

    @property
    def combined(self):
        """Whether all six axes are in one report."""
        return MODELS[self.model][2]

    def start(self, now):
        """Power-up."""
        self._next = None
        self._left = 0  # zero reports still to be sent
        self._second = False  # the rotation's turn
        self._told_keys = self.keys
        self.put(now, led=False, battery=100, sent=0)

    def _step(self):
        return self.period or (0.016 if self.combined else 0.008)  # WLS 16 ms; NAV 8 ms, alternating ids

    def arranged(self, now):
        """A hand has moved the cap or pressed a key."""
        self.deflection = [min(max(int(each), -350), 350) for each in self.deflection]  # NAV: logical -350..350
        if self.keys != self._told_keys:
            self._told_keys = self.keys
            if not self.frozen:
                self.report(bytes([3, self.keys & 3, 0]), now)  # NAV: 03 01 00 pressed, 03 00 00 released
        if any(self.deflection) and self._next is None:
            self._next = self._stream_began = now
            self._stream_count = 0
        if any(self.deflection):
            self._left = self.zeros * (1 if self.combined else 2)

    def next_event(self):
        """The next report."""
        return self._next

    def advance(self, now):
        """Sends what is due."""
        while self._next is not None and self._next <= now:
            when = self._next
            # A pair is finished before the stream ends: the rotation belongs to the translation before it.
            if not any(self.deflection) and not self._second and self._left <= 0:
                self._next = None
                break
            if not any(self.deflection):
                self._left -= 1
            self._send(when)
            self._stream_count += 1
            self._next = self._stream_began + self._stream_count * self._step()
        super().advance(now)

    def _send(self, when):
        if self.frozen:
            return
        if self.combined:
            report = struct.pack("<B6h", 1, *self.deflection)  # WLS: id 1, X Y Z Rx Ry Rz, 16 bits each
        elif self._second:
            report = struct.pack("<B3h", 2, *self.deflection[3:])  # NAV: 02 00 00 e2 ff 00 00
        else:
            report = struct.pack("<B3h", 1, *self.deflection[:3])  # NAV: 01 00 00 00 00 00 00
        if not self.combined:
            self._second = not self._second
        self.sent += 1
        self.report(report, when)

    def tell_battery(self, now):
        """WLS: report 17h: 64 01: full, and a bit of the maker's."""
        if self.combined:
            self.report(bytes([0x17, self.battery, 1]), now)

    def report_out(self, report, now):
        """NAV: 04 01 lights the LED, 04 00 puts it out."""
        if len(report) >= 2 and report[0] == 4:
            self.put(now, led=bool(report[1] & 1))
            return len(report)
        return super().report_out(report, now)

    def get_feature(self, report_id, now):
        """The vendor's feature reports, with zeros in them."""
        if report_id not in FEATURES:
            return STALL
        return bytes([report_id]) + bytes(FEATURES[report_id])


DOUBLE = Spacemouse
