"""A game pad as Linux shows it: a stream of struct input_event, with what it can report as a table.

Sources, named by their letters at the lines below:
  UAPI  Linux include/uapi/linux/input.h, input-event-codes.h, uinput.h (types, codes, the struct of 64-bit machines)
  INP   Linux drivers/input/input.c: input_defuzz_abs_event, what is passed on; evdev.c: SYN_DROPPED
  PAD   Linux Documentation/input/gamepad.rst: which code is which button; negative is left and up
  REAL  getevent -i of an X-Box 360 pad, as public notes on an OUYA have it (045e:028e, version 0114)
SPDX-License-Identifier: Apache-2.0
"""

import struct

from double import ByteDouble, Refused

EVENT = struct.Struct("<qqHHi")  # UAPI: struct timeval of two longs, type, code, value: 24 bytes
SYN, KEY, ABS = 0, 1, 3
REPORT, DROPPED = 0, 3  # codes of EV_SYN
BUTTONS = {"south": 0x130, "east": 0x131, "north": 0x133, "west": 0x134, "tl": 0x136, "tr": 0x137, "select": 0x13A,
           "start": 0x13B, "mode": 0x13C, "thumbl": 0x13D, "thumbr": 0x13E}  # UAPI; REAL has these eleven
AXES = {"left_x": 0, "left_y": 1, "left_trigger": 2, "right_x": 3, "right_y": 4, "right_trigger": 5, "hat_x": 0x10,
        "hat_y": 0x11}
# code -> minimum, maximum, fuzz, flat: REAL
STICK, TRIGGER, HAT = (-32768, 32767, 16, 128), (0, 255, 0, 0), (-1, 1, 0, 0)
RANGES = {0: STICK, 1: STICK, 2: TRIGGER, 3: STICK, 4: STICK, 5: TRIGGER, 0x10: HAT, 0x11: HAT}
# another family's, by the Bluetooth driver xpadneo, as public notes have it: finer triggers, a wider dead zone
NEO = {**RANGES, **{code: (-32768, 32767, 32, 3072) for code in (0, 1, 3, 4)}, 2: (0, 1023, 4, 0), 5: (0, 1023, 4, 0)}
MODELS = {"xbox360": (0x045E, 0x028E, 0x0114, "Microsoft X-Box 360 pad", RANGES),
          "xpadneo": (0x045E, 0x0B22, 0x0500, "Xbox Elite Series 2", NEO)}  # no source for the version and the name
BUS_USB = 3


def defuzzed(value, old, fuzz):
    """INP input_defuzz_abs_event."""
    if fuzz:
        if old - fuzz // 2 < value < old + fuzz // 2:
            return old
        if old - fuzz < value < old + fuzz:
            return int((old * 3 + value) / 4)
        if old - fuzz * 2 < value < old + fuzz * 2:
            return int((old + value) / 2)
    return value


class GamePad(ByteDouble):
    """The pad and the hands on it. Sticks are -1 to 1, triggers 0 to 1."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "model": "xbox360",
        "epoch": 0.0,  # s that the time of the events has at the beginning: evdev's clock is the host's
        "tremor": 0.0,  # of the range: what the sticks wander at rest, every 8 ms, as worn ones do (by a rule)
        "chatty": False,  # an event of a kind that is not in the table ahead of each report: MSC_SCAN
    }
    STATE = ("left_x", "left_y", "right_x", "right_y", "left_trigger", "right_trigger", "hat_x", "hat_y", "buttons",
             "capabilities", "drop", "reports", "written")

    def __init__(self, **options):
        for name in AXES:
            setattr(self, name, 0)
        self.buttons, self.drop, self.reports, self.written = [], 0, 0, 0
        super().__init__(**options)

    def start(self, now):
        """Plugged in: nothing is reported until something changes (INP: only changes are passed on)."""
        if self.model not in MODELS:
            raise Refused(f"no model '{self.model}'; there are {', '.join(MODELS)}")
        self._ranges = MODELS[self.model][4]
        self._values, self._keys = {code: 0 for code in self._ranges}, set()
        self._dropped, self._count = False, 0
        self._next = now + 0.008 if self.tremor else None
        self.now = now

    @property
    def identity(self):
        """Bus, vendor, product, version, name."""
        return (BUS_USB, *MODELS[self.model][:4])

    @property
    def capabilities(self):
        """What EVIOCGBIT and EVIOCGABS would tell."""
        return {"bus": BUS_USB, "vendor": MODELS[self.model][0], "product": MODELS[self.model][1],
                "version": MODELS[self.model][2], "name": MODELS[self.model][3], "keys": sorted(BUTTONS.values()),
                "abs": {str(code): dict(zip(("minimum", "maximum", "fuzz", "flat"), each))
                        for code, each in self._ranges.items()}}

    def _raw(self, code, value):
        """A stick's deflection or a trigger's way in the numbers of its axis."""
        least, most = self._ranges[code][:2]
        if code in (0x10, 0x11):
            return max(-1, min(1, round(value)))
        value = max(-1.0 if least < 0 else 0.0, min(1.0, float(value)))
        return round(value * most) if value >= 0 or least == 0 else round(-value * least)

    def arranged(self, now):
        """A hand has moved: the changes, and a report (UAPI: EV_SYN, SYN_REPORT)."""
        for name in self.buttons:
            if name not in BUTTONS:
                raise Refused(f"no button '{name}'; there are {', '.join(BUTTONS)}")
        self._report(now)

    def _report(self, now, wander=0):
        events = []
        held = {BUTTONS[name] for name in self.buttons}
        for code in sorted(held ^ self._keys):
            events.append((KEY, code, int(code in held)))
        self._keys = held
        for name, code in AXES.items():
            value = self._raw(code, getattr(self, name))
            if wander and code in (0, 1, 3, 4):
                least, most = self._ranges[code][:2]
                value = max(least, min(most, value + wander))
            value = defuzzed(value, self._values[code], self._ranges[code][2])
            if value != self._values[code]:
                self._values[code] = value
                events.append((ABS, code, value))
        if not events:
            return
        if self.drop > 0:  # a reader that was too slow
            self.drop -= 1
            self._dropped = True
            return
        if self._dropped:
            # INP evdev: the buffer was full: SYN_DROPPED stands where events were; the state has to be asked for
            self._dropped = False
            events.insert(0, (SYN, DROPPED, 0))
        if self.chatty:
            events.insert(0, (4, 4, 0x90001))  # EV_MSC, MSC_SCAN
        self.reports += 1
        self._write(events + [(SYN, REPORT, 0)], now)

    def _write(self, events, now):
        seconds, micros = divmod(round((self.epoch + now) * 1e6), 1000000)
        self.answer(b"".join(EVENT.pack(seconds, micros, *each) for each in events), now)

    def next_event(self):
        """The next tremor."""
        return self._next

    def advance(self, now):
        """Sticks that wander."""
        while self._next is not None and self._next <= now:
            at, self._next = self._next, self._next + 0.008
            self._count += 1
            super().advance(at)
            self._report(at, round(self.tremor * 32767) * (1 if self._count % 4 < 2 else -1))
        super().advance(now)

    def take(self, byte, now):
        """What a host writes: lamps and rumble, of which this pad has none."""
        self.written += 1


DOUBLE = GamePad
