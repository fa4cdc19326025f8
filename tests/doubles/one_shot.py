"""The far end of a heartbeat line: a retriggerable one-shot and the contact of the relay behind it.

Sources, named by their letters at the lines below:
  NX   Nexperia/NXP 74HC123; 74HCT123 product data sheet (rev. 9, 2015), sections 1, 6 and the notes to the dynamic
       characteristics; the same text in the Philips specification of 1998
  NS   National Semiconductor MM54HC123A/MM74HC123A data sheet, "Retrigger operation"
  TI   Texas Instruments SN74AHCT123A data sheet SCLS420G, page 2
SPDX-License-Identifier: Apache-2.0
"""


def width(ohm, farad, k=0.45):
    """Seconds of one output pulse: tW = K R C for C above 10 nF (NX). K = 0.45 at 5 V in newer sheets, 0.55 in that of
    1998 (both NX): a design leaves room for that."""
    return k * ohm * farad


class OneShot:
    """Input B with A low and the reset high (NX function table): a rising edge begins a pulse, or prolongs the one that
    is there, to `width` seconds after the last edge (NX section 1, NS). A level does nothing, high or low. Low at
    power-up (TI). Behind it the relay: its contact closes when the pulse has been there for `operate` seconds, so that
    with an on-delay longer than the pulse one edge alone closes nothing, and opens `release` seconds after the pulse."""

    def __init__(self, seconds, release=0.0, operate=0.0):
        self.width, self.release, self.operate = seconds, release, operate
        self.level = self.closed = False
        self.began = self.until = None  # of the pulse; None: no pulse

    def input(self, level, now):
        """The line at B; returns as advance()."""
        changes = self.advance(now)
        if level and not self.level:
            if self.until is None or self.until <= now:
                self.began = now
            self.until = now + self.width
        self.level = level
        return changes + self.advance(now)

    @property
    def next(self):
        """When the contact moves if no edge comes before; None: not by itself."""
        if self.closed:
            return self.until + self.release
        return None if self.until is None else min(self.began + self.operate, self.until)

    def advance(self, now):
        """What the contact has done by now: [(time, closed)]."""
        changes = []
        while (due := self.next) is not None and due <= now:
            if self.closed:
                self.closed, self.until = False, None
                changes.append((due, False))
            elif self.began + self.operate < self.until:
                self.closed = True
                changes.append((due, True))
            else:
                self.until = None  # too short for the relay
        return changes
