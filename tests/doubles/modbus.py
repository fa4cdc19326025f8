"""Modbus as a slave meets it: RTU frames cut by silence, MBAP headers on TCP, functions on a map of 16-bit registers.

Sources, named by their letters at the lines below:
  APP   MODBUS application protocol specification V1.1b3: functions, exceptions (chapters 6 and 7)
  SER   MODBUS over serial line specification V1.02: 2.2 addressing, 2.5.1 RTU framing, 2.5.1.1 the times, 6.2.2 CRC
  TCP   MODBUS messaging on TCP/IP implementation guide V1.0b: 3.1.3 MBAP header
  PYM   github riptideio/pymodbus (framer/rtu.py, framer/socket.py): what a host sends
SPDX-License-Identifier: Apache-2.0
"""

import struct

from double import ByteDouble

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4  # APP 7
READ_HOLDING, READ_INPUT, WRITE_ONE, DIAGNOSE, WRITE_MANY = 0x03, 0x04, 0x06, 0x08, 0x10  # APP 6


class Exceptional(Exception):
    """An exception response."""

    def __init__(self, code):
        super().__init__(code)
        self.code = code


def crc(data):
    """SER 6.2.2: start 0xFFFF, polynomial 0xA001 from the low end; low byte first on the line."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


class ModbusDouble(ByteDouble):
    """The slave; the instrument is `read_word`, `write_words` and FUNCTIONS."""

    OPTIONS = {
        **ByteDouble.OPTIONS,
        "wire": "rtu",  # or tcp
        "unit": 1,
        "baud": 9600,  # for the silences of RTU; the server's --baud is for the bytes
        "work": 0.002,  # s from the end of a frame to its answer. no source: instruments take 1 to 50 ms
        "chatty": False,  # RTU: the frame comes back, and a byte of zero as the driver turns; TCP: an answer to another
    }
    FUNCTIONS = (READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY)
    MOST = 125  # registers of one frame; APP 6.3

    def start(self, now):
        """Power-up: an empty line."""
        self._frame, self._broken, self._last = bytearray(), False, None
        self.frames = self.dropped = 0

    # -- what the instrument does ---------------------------------------------------------------------------

    def read_word(self, address, function, now):
        """One register; raises Exceptional."""
        raise NotImplementedError

    def write_words(self, address, words, now):
        """Writes registers; raises Exceptional."""
        raise NotImplementedError

    def check_range(self, address, count):
        """Whether registers can be asked for together; raises Exceptional."""

    # -- RTU ------------------------------------------------------------------------------------------------

    @property
    def _character(self):
        return 11.0 / self.baud  # SER 2.5.1: 11 bits

    @property
    def silence(self):
        """SER 2.5.1.1: 3.5 characters, 1.75 ms above 19200 baud."""
        return 1.75e-3 if self.baud > 19200 else 3.5 * self._character

    @property
    def _gap(self):
        return 0.75e-3 if self.baud > 19200 else 1.5 * self._character

    def next_event(self):
        """The end of a frame."""
        return self._last + self.silence if self._frame and self.wire == "rtu" else None

    def advance(self, now):
        """A silence ends a frame."""
        if self.wire == "rtu" and self._frame and now >= self._last + self.silence - 1e-9:
            ended, frame, broken = self._last + self.silence, bytes(self._frame), self._broken
            self._frame.clear()
            super().advance(ended)
            self._rtu(frame, broken, ended)
        super().advance(now)

    def take(self, byte, now):
        """One byte of the host."""
        if self.wire == "tcp":
            self._frame.append(byte)
            self._mbap(now)
            return
        if self._frame and now > self._last + self._gap + 1e-9:
            self._broken = True  # SER 2.5.1.1: a gap of more than 1.5 characters: the frame is incomplete
        if not self._frame:
            self._broken = False
        self._frame.append(byte)
        self._last = now

    def _rtu(self, frame, broken, now):
        if (broken and self.strict) or len(frame) < 4 or crc(frame[:-2]) != frame[-2:]:
            self.dropped += 1
            self.tell(now, "dropped", frame)  # SER 2.5.1: no answer
            return
        if frame[0] not in (0, self.unit):
            return
        answer = self._answer(frame[1:-2], now)
        if self.chatty:
            self.answer(frame + b"\0", now)
        if frame[0]:  # SER 2.2: 0 is for all, and no one answers
            self.answer(bytes([self.unit]) + answer + crc(bytes([self.unit]) + answer), now, self.work)

    # -- TCP ------------------------------------------------------------------------------------------------

    def _mbap(self, now):
        """TCP 3.1.3: transaction, protocol 0, length of what follows, unit."""
        if len(self._frame) < 7:
            return
        transaction, protocol, length, unit = struct.unpack_from(">HHHB", self._frame)
        if protocol or not 2 <= length <= 254:
            self.dropped += 1
            self._frame.clear()  # no source: a header that is wrong; the connection stays
            return
        if len(self._frame) < 6 + length:
            return
        body = bytes(self._frame[7:6 + length])
        del self._frame[:6 + length]
        answer = self._answer(body, now)
        if self.chatty:
            other = b"\x03\x02\xAB\xCD"
            self.answer(struct.pack(">HHHB", transaction - 1 & 0xFFFF, 0, len(other) + 1, unit) + other, now)
        self.answer(struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit) + answer, now, self.work)

    # -- functions ------------------------------------------------------------------------------------------

    def _answer(self, body, now):
        self.frames += 1
        self.tell(now, "request", body)
        try:
            return self._function(body[0], body[1:], now)
        except Exceptional as exception:
            self.tell(now, "exception", exception.code)
            return bytes([body[0] | 0x80, exception.code])  # APP 7

    def _function(self, function, data, now):
        if function not in self.FUNCTIONS:
            raise Exceptional(ILLEGAL_FUNCTION)
        if function in (READ_HOLDING, READ_INPUT):
            if len(data) != 4:
                raise Exceptional(ILLEGAL_VALUE)
            address, count = struct.unpack(">HH", data)
            if not 1 <= count <= self.MOST:
                raise Exceptional(ILLEGAL_VALUE)  # APP 6.3
            self.check_range(address, count)
            words = [self.read_word(each, function, now) & 0xFFFF for each in range(address, address + count)]
            return struct.pack(f">BB{count}H", function, 2 * count, *words)
        if function == WRITE_ONE:
            if len(data) != 4:
                raise Exceptional(ILLEGAL_VALUE)
            address, value = struct.unpack(">HH", data)
            self.check_range(address, 1)
            self.write_words(address, [value], now)
            return bytes([function]) + data  # APP 6.6: an echo
        if function == DIAGNOSE:
            if data[:2] != b"\0\0":
                raise Exceptional(ILLEGAL_FUNCTION)  # APP 6.8: sub-function 0 returns what came
            return bytes([function]) + data
        if len(data) < 5:
            raise Exceptional(ILLEGAL_VALUE)
        address, count, size = struct.unpack_from(">HHB", data)
        if not 1 <= count <= self.MOST or size != 2 * count or len(data) != 5 + size:
            raise Exceptional(ILLEGAL_VALUE)  # APP 6.12
        self.check_range(address, count)
        self.write_words(address, list(struct.unpack(f">{count}H", data[5:])), now)
        return struct.pack(">BHH", function, address, count)
