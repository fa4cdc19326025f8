"""The USB end of an instrument of the Test & Measurement class with USB488: control requests, bulk and interrupt pipes.

Sources, named by their letters at the lines below:
  TMC   USBTMC specification 1.0 (2003), tables 1 to 9 (bulk headers), 15 to 38 (control requests), as tinyusb's usbtmc.h,
        embassy-usb's class::usbtmc and Linux' include/uapi/linux/usb/tmc.h repeat them
  488   USBTMC-USB488 subclass 1.0, tables 8 to 21, from the same
  PY    github python-ivi/python-usbtmc usbtmc/usbtmc.py: what a host sends and takes apart
SPDX-License-Identifier: Apache-2.0
"""

import struct

from double import STALL, UsbDouble

MSG_OUT, REQUEST_IN, MSG_IN, TRIGGER = 1, 2, 2, 128  # TMC table 2, 488 table 1; PY
SUCCESS, PENDING, FAILED, NOT_IN_PROGRESS = 0x01, 0x02, 0x80, 0x81  # TMC table 16
INTERRUPT_BUSY = 0x20  # 488 table 12
HEADER = 12
CLASS_IN_INTERFACE, CLASS_IN_ENDPOINT = 0xA1, 0xA2  # bmRequestType: device to host, class, interface or endpoint
CLEAR_FEATURE = 1  # USB 2.0 table 9-4; feature 0 is ENDPOINT_HALT


class UsbtmcDouble(UsbDouble):
    """The pipes; the instrument behind them is `program`, `trigger`, `reset_input`, `status_byte` and `respond`."""

    OPTIONS = {
        **UsbDouble.OPTIONS,
        "pieces": 0,  # the most bytes of data in one DEV_DEP_MSG_IN; 0: as many as the host takes
        "interrupt": True,  # has an interrupt pipe: the status byte goes there (488 4.3.1)
        "chatty": False,  # a service request (488 table 7) on the interrupt pipe before each answer, not enabled
    }
    CLASS = (0xFE, 3, 1)  # TMC 4.2.2, 488 3.2: application class, test and measurement, USB488
    BULK_OUT, BULK_IN, INTERRUPT_IN = 0x02, 0x81, 0x83  # no source: an instrument numbers its endpoints as it likes
    PACKET = 64  # USB 2.0: the longest bulk packet at full speed
    SCPI = True

    def start(self, now):
        """Power-up: pipes are empty and run."""
        self.halted = set()
        self._input = bytearray()  # data of a message that has not ended
        self._part = bytearray()  # packets of a transfer that has not ended
        self._answers = []  # (time, bytes): response messages
        self._request = None  # (tag, most bytes, terminator or None)
        self._interrupts = []
        self._tag = self._sent = self._got = 0

    # -- what the instrument does ---------------------------------------------------------------------------

    def program(self, message, now):
        """A whole program message has come."""
        raise NotImplementedError

    def trigger(self, now):
        """488 3.2.1.1: the trigger message."""

    def status_byte(self, now):
        """The status byte of IEEE 488.2."""
        raise NotImplementedError

    def reset_input(self, now):
        """A clear empties the instrument's parser."""

    def query_error(self, code, now):
        """IEEE 488.2 6.3: -410 INTERRUPTED, -420 UNTERMINATED."""

    def busy(self, now):
        """Whether a message that has come is still being worked on, so that an answer may follow."""
        return False

    def respond(self, data, now, after=0.0):
        """A response message; IEEE 488.2: it ends with a line feed."""
        self._answers.append((now + self.late + after, bytes(data)))
        if self.chatty:
            self._interrupts.append(bytes([0x81, self.status_byte(now) | 0x40]))

    @property
    def output_ready(self):
        """Whether a response waits for the host: MAV."""
        return bool(self._answers)

    # -- bulk pipes ------------------------------------------------------------------------------------------

    def bulk_out(self, endpoint, data, now):
        """One write of the host to a bulk endpoint; returns the bytes taken or a negative errno."""
        self.advance(now)
        if endpoint != self.BULK_OUT or endpoint in self.halted:
            return STALL
        self._part += data
        if len(self._part) >= HEADER:
            whole = self._length()
            if len(self._part) < whole and len(data) % self.PACKET == 0:
                return len(data)  # USB 2.0 5.8.3: a transfer ends with a packet that is not full
        part, self._part = bytes(self._part), bytearray()
        if not self._transfer(part, now):
            self.tell(now, "halted", part[:HEADER])
            self.halted.add(self.BULK_OUT)  # TMC 3.2.2.3: a header that is wrong halts the pipe
            return STALL
        return len(data)

    def _length(self):
        kind, size = self._part[0], struct.unpack_from("<I", self._part, 4)[0]
        return HEADER + (size + 3) // 4 * 4 if kind == MSG_OUT else HEADER

    def _transfer(self, data, now):
        """One Bulk-OUT message; False where its header is wrong."""
        if len(data) < HEADER:
            return False
        kind, tag, inverse, reserved = data[:4]
        if tag == 0 or inverse != ~tag & 0xFF or (self.strict and (reserved or tag == self._tag)):
            return False  # TMC table 1: 1 <= bTag <= 255, its complement, and another one than before
        self._tag = tag
        if kind == MSG_OUT:
            return self._message(data, now)
        if kind == REQUEST_IN:
            return self._asked(data, tag, now)
        if kind == TRIGGER:
            self.trigger(now)
            return True
        return False

    def _message(self, data, now):
        size, attributes = struct.unpack_from("<IB", data, 4)
        body, padding = data[HEADER:HEADER + size], data[HEADER + size:]
        if len(body) < size or size == 0 or len(data) % 4 and self.strict or len(padding) > 3:
            return False  # TMC 3.2.1: TransferSize > 0, the whole is a multiple of four with bytes that say nothing
        self._got = size
        if self._answers:
            self._answers.clear()
            self.query_error(-410, now)  # 488.2 6.3.2.3: a message before the response was read: it is lost
        self._request = None  # no source: a request that nothing answered and that was not aborted
        self._input += body
        if attributes & 1:  # TMC table 3: EOM
            message, self._input = bytes(self._input), bytearray()
            self.program(message, now)
        return True

    def _asked(self, data, tag, now):
        size, attributes, terminator = struct.unpack_from("<IBB", data, 4)
        if size == 0:
            return False  # TMC table 4
        if not self._answers and not self.busy(now):
            self.query_error(-420, now)  # 488.2 6.3.2.2; the host waits in vain
        self._request = (tag, size, bytes([terminator]) if attributes & 2 else None)
        return True

    def bulk_in(self, endpoint, length, now):
        """One read of the host: bytes, None where the pipe has nothing yet, or a negative errno."""
        self.advance(now)
        if endpoint == self.INTERRUPT_IN and self.interrupt:
            return self._interrupts.pop(0)[:length] if self._interrupts else None
        if endpoint != self.BULK_IN or endpoint in self.halted:
            return STALL
        if self._request is None or not self._answers or self._answers[0][0] > now:
            return None
        tag, most, terminator = self._request
        data = self._answers[0][1]
        size = min(most, self.pieces or most, len(data))
        if terminator is not None and terminator in data[:size]:
            size = data.index(terminator) + 1
        part, rest = data[:size], data[size:]
        if rest:
            self._answers[0] = (self._answers[0][0], rest)
        else:
            self._answers.pop(0)
        self._request, self._sent = None, size
        # TMC table 9: bit 0: the last byte of the message; bit 1: the terminator asked for is the last byte
        ended = (0 if rest else 1) | (2 if terminator is not None and part.endswith(terminator) else 0)
        head = struct.pack("<BBBBIBBBB", MSG_IN, tag, ~tag & 0xFF, 0, size, ended, 0, 0, 0)
        return (head + part + bytes(-len(part) % 4))[:length]

    def wait_in(self):
        """When the pipe that was asked may have something, or None."""
        return self._answers[0][0] if self._request is not None and self._answers else None

    # -- control ---------------------------------------------------------------------------------------------

    def control(self, request_type, request, value, index, length_or_data, now):
        """Class requests, and CLEAR_FEATURE of a halt."""
        self.advance(now)
        if request_type == 0x02 and request == CLEAR_FEATURE and value == 0:
            self.halted.discard(index)
            return 0
        if request_type == CLASS_IN_INTERFACE:
            answer = self._of_interface(request, value, now)
        elif request_type == CLASS_IN_ENDPOINT:
            answer = self._of_endpoint(request, value, index)
        else:
            answer = None
        if answer is None:
            return (STALL, b"") if request_type & 0x80 else STALL
        answer = answer[:length_or_data]
        return len(answer), answer

    def _of_interface(self, request, value, now):
        if request == 7:  # TMC table 37, 488 table 8: PY get_capabilities
            return struct.pack("<BBHBB6xHBB8x", SUCCESS, 0, 0x0100, 0, 1, 0x0100, 0x07, 0x0F if self.SCPI else 0x07)
        if request == 5:  # INITIATE_CLEAR: TMC 4.2.1.6: input and output are emptied, Bulk-OUT is halted
            self._input.clear()
            self._part.clear()
            self._answers.clear()
            self._request = None
            self.halted.add(self.BULK_OUT)
            self.reset_input(now)
            self.tell(now, "clear", True)
            return bytes([SUCCESS])
        if request == 6:
            return bytes([SUCCESS, 0])  # bmClear: nothing is left in the Bulk-IN queue
        if request == 128 and 2 <= value <= 127:  # 488 table 11: READ_STATUS_BYTE with its own tag
            if not self.interrupt:
                return bytes([SUCCESS, value, self.status_byte(now)])
            if self._interrupts:
                return bytes([INTERRUPT_BUSY, value, 0])  # as the maker's manual warns: the pipe is not read
            self._interrupts.append(bytes([0x80 | value, self.status_byte(now)]))  # 488 table 7
            return bytes([SUCCESS, value, 0])
        if request in (160, 161, 162):  # 488 table 15: REN_CONTROL, GO_TO_LOCAL, LOCAL_LOCKOUT
            return bytes([SUCCESS])
        return None

    def _of_endpoint(self, request, value, index):
        if request == 1 and index == self.BULK_OUT:  # TMC table 18
            running = len(self._part) > 1 and self._part[1] == value
            if running:
                self._part.clear()
                self.halted.add(self.BULK_OUT)
            return bytes([SUCCESS if running else NOT_IN_PROGRESS, self._tag])
        if request == 2 and index == self.BULK_OUT:
            return struct.pack("<BxxxI", SUCCESS, self._got)
        if request == 3 and index == self.BULK_IN:  # TMC table 24
            running = self._request is not None and self._request[0] == value
            told = self._request[0] if self._request else 0
            if running:
                self._request = None
            return bytes([SUCCESS if running else (FAILED if told == 0 else NOT_IN_PROGRESS), told])
        if request == 4 and index == self.BULK_IN:
            return struct.pack("<BBxxI", SUCCESS, 0, self._sent)
        return None


class UsbtmcLine:
    """The two bulk pipes as one stream of bytes: each transfer as it is, its length from its header.

    A halt cannot be seen here but in the state; what came after it is lost, as on the pipe."""

    def __init__(self, double):
        self.double = double
        self._buffer = bytearray()

    def receive(self, data, now):
        """Bytes of the host: whole Bulk-OUT messages."""
        self._buffer += data
        while len(self._buffer) >= HEADER:
            size = struct.unpack_from("<I", self._buffer, 4)[0] if self._buffer[0] == MSG_OUT else 0
            whole = HEADER + (size + 3) // 4 * 4
            if len(self._buffer) < whole:
                return
            message = bytes(self._buffer[:whole])
            del self._buffer[:whole]
            self.double.bulk_out(self.double.BULK_OUT, message, now)

    def say(self, now):
        """Bulk-IN messages that are due."""
        told = []
        while isinstance(data := self.double.bulk_in(self.double.BULK_IN, 1 << 30, now), bytes):
            told.append((now, data))
        return told

    def next(self):
        """When there will be something."""
        times = [each for each in (self.double.next_event(), self.double.wait_in()) if each is not None]
        return min(times, default=None)
