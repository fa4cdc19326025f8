"""A USB serial adapter with an FTDI chip (FT232R), and what hangs on its pins: an instrument, or a heartbeat's one-shot.

Sources, named by their letters at the lines below:
  SIO  Linux drivers/usb/serial/ftdi_sio.h (by its author from FTDI's details of the protocol): requests, the two status
       bytes before each packet, descriptors
  USB  USB 2.0, chapters 5.8 and 9: packets of a bulk endpoint, what is not supported stalls
  one_shot.py has those of what may hang on RTS or DTR.
SPDX-License-Identifier: Apache-2.0
"""

import importlib

from double import Refused, STALL, UsbDouble
from one_shot import OneShot

RESET, MODEM_CTRL, SET_FLOW, SET_BAUD, SET_DATA, GET_STATUS, EVENT_CHAR, ERROR_CHAR = range(8)  # SIO
SET_LATENCY, GET_LATENCY = 9, 10  # SIO
READ_EEPROM = 0x90  # no source: newer kernels ask an FT232R for its pins' use; a stall is taken for "none"
DTR, RTS = 1, 2  # SIO: bits of the value, and of the mask in its high byte
PACKET = 64  # SIO, bytes; two of them are status
MODEM_STATUS = 0x01 | 0x10 | 0x20 | 0x80  # SIO: bit 0 is always set; CTS, DSR, RLSD, as with a cable that loops them
LINE_STATUS = 0x20 | 0x40  # SIO: transmitter empty


class FtdiAdapter(UsbDouble):
    """The adapter; the state and the settings of the instrument at its pins are told and set beside its own."""

    OPTIONS = {
        **UsbDouble.OPTIONS,
        "serial": "FT1A2B3C",
        "instrument": "",  # of tests/doubles, at TXD and RXD
        "line": "rts",  # or dtr: the pin at which the one-shot is
        "one_shot": 0.0,  # s of its pulse; 0: there is none
        "relay_release": 0.0,  # s in which the relay behind it opens
        "relay_operate": 0.0,  # s in which it closes
    }
    STATE = ("rts", "dtr", "divisor", "data", "latency", "flow", "amplifiers", "edges", "sent", "received")
    VENDOR, PRODUCT = 0x0403, 0x6001  # SIO: FTDI_VID, FTDI_8U232AM_PID, which the FT232R has too
    BULK_IN, BULK_OUT = 0x81, 0x02  # no source for an FT232R's numbers; SIO lists 0x82 and 0x02 of an older chip
    firmware = 0x0600  # no source at hand: bcdDevice by which Linux knows an FT232R
    inner = None

    def __init__(self, **options):
        kind = options.get("instrument", "")
        try:
            self.inner = importlib.import_module(kind).DOUBLE() if kind else None
        except (ImportError, AttributeError) as error:
            raise Refused(f"there is no double named '{kind}'") from error
        self._shot, self._status_at = None, 0.0
        super().__init__(**options)
        if self.inner is not None:
            self.STATE = (*FtdiAdapter.STATE, *self.inner.STATE)

    def __getattr__(self, name):
        """What only the instrument has."""
        if self.inner is None or name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.inner, name)

    def start(self, now):
        """Power-up: both lines are off (no source for the pins before a host has come)."""
        self._shot = OneShot(self.one_shot, self.relay_release, self.relay_operate) if self.one_shot > 0 else None
        self._waiting = b""  # bytes of the instrument for the host
        self.put(now, rts=0, dtr=0, divisor=0, data=8, latency=16, flow=0, edges=0, sent=0, received=0,
                 amplifiers=self._shot is None)

    def power_cycle(self, now):
        """Adapter and instrument."""
        super().power_cycle(now)
        if self.inner is not None:
            self.inner.power_cycle(now)

    def arrange(self, now, **changes):
        """Names that the adapter has not are the instrument's."""
        mine = {name: value for name, value in changes.items() if name in self.OPTIONS or name in FtdiAdapter.STATE}
        if rest := {name: value for name, value in changes.items() if name not in mine}:
            if self.inner is None:
                raise Refused(f"nothing named '{', '.join(rest)}' to set")
            self.inner.arrange(now, **rest)
        super().arrange(now, **mine)

    def advance(self, now):
        """A relay moves by itself, an instrument speaks by itself."""
        super().advance(now)
        for at, closed in [] if self._shot is None else self._shot.advance(now):
            self.put(at, amplifiers=closed)
        if self.inner is not None:
            self._waiting += b"".join(data for _, data in self.inner.say(now))

    def next_event(self):
        """When the relay moves, or the instrument has something to say."""
        times = [None if self._shot is None else self._shot.next, None if self.inner is None else self.inner.next()]
        return min((each for each in times if each is not None), default=None)

    # -- the pins ------------------------------------------------------------------------------------------

    def _set_lines(self, value, now):
        changes = {name: int(bool(value & bit)) for name, bit in (("dtr", DTR), ("rts", RTS)) if value >> 8 & bit}
        self.put(now, **changes)
        if self._shot is None or self.line not in changes:
            return
        high = bool(changes[self.line])
        if high and not self._shot.level:
            self.edges += 1
        for at, closed in self._shot.input(high, now):
            self.put(at, amplifiers=closed)

    # -- the bus -------------------------------------------------------------------------------------------

    def control(self, request_type, request, value, index, length_or_data, now):
        """SIO: requests of the vendor, without data but for two questions."""
        self.advance(now)
        self.tell(now, "request", [request, value, index])
        if request_type == 0xC0:
            answer = {GET_STATUS: bytes([MODEM_STATUS, LINE_STATUS]), GET_LATENCY: bytes([self.latency])}.get(request)
            return (STALL, b"") if answer is None else (min(len(answer), length_or_data), answer[:length_or_data])
        if request_type != 0x40:
            return STALL
        if request == RESET:
            if value == 1:  # SIO: purge of what was received
                self._waiting = b""
        elif request == MODEM_CTRL:
            self._set_lines(value, now)
        elif request == SET_FLOW:
            self.put(now, flow=index >> 8)
        elif request == SET_BAUD:
            self.put(now, divisor=value | (index & 0xFF00) << 8)
        elif request == SET_DATA:
            self.put(now, data=value & 0xFF)
        elif request == SET_LATENCY:
            self.put(now, latency=value & 0xFF)
        elif request not in (EVENT_CHAR, ERROR_CHAR):
            return STALL
        return 0

    def bulk_out(self, data, now):
        """Bytes of the host for the instrument."""
        self.advance(now)
        self.sent += len(data)
        if self.inner is not None:
            self.inner.receive(data, now)

    def bulk_in(self, size, now):
        """What one transfer of that many bytes gets: packets that begin with two status bytes each; None: not yet. SIO:
        without data there is a packet each `latency` ms."""
        self.advance(now)
        if not self._waiting and now < self._status_at:
            return None
        self._status_at = now + self.latency * 1e-3
        head, packets = bytes([MODEM_STATUS, LINE_STATUS]), b""
        while len(packets) + PACKET <= max(size, PACKET):
            part, self._waiting = self._waiting[:PACKET - 2], self._waiting[PACKET - 2:]
            packets += head + part
            self.received += len(part)
            if len(part) < PACKET - 2:  # USB 5.8.3: a short packet ends the transfer
                break
        return packets

    def next(self):
        """Also when a packet without data is due."""
        return min((each for each in (self.next_event(), self._status_at) if each is not None), default=None)


DOUBLE = FtdiAdapter
