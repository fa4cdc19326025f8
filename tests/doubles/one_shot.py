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
    power-up (TI)."""

    def __init__(self, seconds, release=0.0):
        self.width = seconds
        self.release = release  # s, in which the contact of the relay opens after the pulse
        self.level = False
        self.until = None  # the end of the pulse; None: no pulse

    def input(self, level, now):
        """The line at B."""
        if level and not self.level:
            self.until = now + self.width
        self.level = level

    @property
    def opens(self):
        """When the contact opens if no edge comes before; None where it is open."""
        return None if self.until is None else self.until + self.release

    def advance(self, now):
        """Returns the time at which the contact opened, once, or None."""
        opened = self.opens
        if opened is None or now < opened:
            return None
        self.until = None
        return opened
