"""A USB device outside of the machine that it is plugged into: a double behind QEMU's usb-redir.

What happens to that machine (a panic, sleep, its end) does not happen to the double. Spoken is the usbredir protocol
0.7 as usbredirproto.h of Debian's libusbredirparser-dev has it.
SPDX-License-Identifier: Apache-2.0
"""

import pathlib
import select
import socket
import struct
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "doubles"))

import serve  # noqa: E402
from double import HidDouble, STALL  # noqa: E402
from gadget import report_descriptor  # noqa: E402
from usb_device import UsbDevice  # noqa: E402

HELLO, CONNECT, DISCONNECT, RESET, INTERFACES, ENDPOINTS = range(6)
SET_CONFIGURATION, GET_CONFIGURATION, CONFIGURATION_STATUS = 6, 7, 8
SET_ALTERNATE, GET_ALTERNATE, ALTERNATE_STATUS = 9, 10, 11
START_INTERRUPT, STOP_INTERRUPT, INTERRUPT_STATUS, CANCEL = 15, 16, 17, 21
CONTROL, BULK, INTERRUPT = 100, 101, 103
OK, CANCELLED, IO_ERROR, STALLED, TIMED_OUT = 0, 1, 3, 4, 5
FULL_SPEED, NO_TYPE, TYPE_CONTROL = 1, 255, 0
# usb_redir_cap_connect_device_version, ep_info_max_packet_size, 64bits_ids, 32bits_bulk_length: what QEMU's xhci wants.
CAPABILITIES = 1 << 1 | 1 << 4 | 1 << 5 | 1 << 6
IN_ENDPOINT = 0x81


class Redirected:
    """One device; serves in a thread of its own until close()."""

    def __init__(self, instrument, options, path):
        self.double = serve.make(instrument, options)
        self.path = str(path)
        self.hid = isinstance(self.double, HidDouble)
        self.device = UsbDevice(self.double, report_descriptor(self.double, False, 64) if self.hid else b"")
        self.asked = []  # bulk transfers to the machine that wait for data: (id, endpoint, bytes)
        self.began = time.monotonic()
        self.lock = threading.Lock()
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(self.path)
        self.listener.listen(1)
        self.machine = None
        self.plugged = self.wanted = True
        self.receiving, self.configured, self.open = False, 0, True
        self.wake_reader, self.wake_writer = socket.socketpair()
        self.buffer, self.serial = b"", 0
        self.orders = serve.Orders(self.double, self)
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    # -- orders, from another thread ----------------------------------------------------------------------

    def now(self):
        """Seconds since the start, as in the history."""
        return time.monotonic() - self.began

    def obey(self, text):
        """One order of tests/doubles/README.md; its answer."""
        with self.lock:
            answer = self.orders.obey(text, self.now())
        self.wake_writer.send(b"!")
        return answer

    def unplug(self):
        """The cable is out; the instrument keeps its power."""
        self.wanted = False

    def plug(self):
        """The cable is in."""
        self.wanted = True
        return self.path

    def close(self):
        """Ends the thread."""
        self.open = False
        self.wake_writer.send(b"!")
        self.thread.join()
        self.listener.close()

    # -- the protocol -------------------------------------------------------------------------------------

    def _serve(self):
        while self.open:
            waiting = [self.wake_reader, self.machine or self.listener]
            with self.lock:
                due = self.double.next() if self.asked or not self.device.bulk else self.double.next_event()
            timeout = None if due is None else max(0.0, due - self.now())
            ready, _, _ = select.select(waiting, [], [], timeout)
            if self.wake_reader in ready:
                self.wake_reader.recv(4096)
            if self.listener in ready:
                self.machine, _ = self.listener.accept()
                self.buffer, self.plugged, self.configured = b"", False, None
                self._say(HELLO, 0, struct.pack("<64sI", b"vitreo double", CAPABILITIES))
            elif self.machine in ready:
                self._take()
            with self.lock:
                self._report()

    def _take(self):
        try:
            data = self.machine.recv(65536)
        except OSError:
            data = b""
        if not data:
            self.machine = None
            return
        self.buffer += data
        while (size := len(self._head(0, 0, 0))) <= len(self.buffer):
            kind, length = struct.unpack_from("<II", self.buffer)
            if len(self.buffer) < size + length:
                return
            number = int.from_bytes(self.buffer[8:size], "little")
            body, self.buffer = self.buffer[size:size + length], self.buffer[size + length:]
            with self.lock:
                self._packet(kind, number, body)

    def _head(self, kind, length, number):
        """Ids have 64 bits once both ends have said hello, which is the first packet either way."""
        return struct.pack("<III" if self.configured is None else "<IIQ", kind, length, number)

    def _say(self, kind, number, body):
        if self.machine is not None:
            try:
                self.machine.sendall(self._head(kind, len(body), number) + body)
            except OSError:
                self.machine = None

    def _report(self):
        """Cable in or out, and what the double has to say."""
        if self.machine is not None and self.plugged != self.wanted and self.configured is not None:
            self.plugged = self.wanted
            if self.plugged:
                self._connect()
            else:
                self.receiving, self.asked = False, []
                self._say(DISCONNECT, 0, b"")
        self.double.advance(self.now())
        while self.hid and (report := self.double.input(self.now())) is not None:
            if self.receiving:
                self.serial += 1
                self._say(INTERRUPT, self.serial, struct.pack("<BBH", IN_ENDPOINT, OK, len(report)) + report)
        while self.asked and (data := self.double.bulk_in(self.asked[0][2], self.now())) is not None:
            number, end, _ = self.asked.pop(0)
            self._say_bulk(number, end, OK, data, len(data))

    def _connect(self):
        # Index: the endpoint's number, and 16 more for those towards the machine.
        ends = {0: TYPE_CONTROL, 16: TYPE_CONTROL}
        ends.update({(address & 0x0F) + (16 if address & 0x80 else 0): how for address, how in self.device.ends.items()})
        row = lambda value, other: bytes(value if each in ends else other for each in range(32))  # noqa: E731
        self._say(INTERFACES, 0, struct.pack("<I", 1) + b"".join(
            bytes([each]) + bytes(31) for each in (0, self.device.interface, 0, 0)))
        self._say(ENDPOINTS, 0, bytes(ends.get(each, NO_TYPE) for each in range(32)) + row(1, 0) + bytes(32) +
                  struct.pack("<32H", *(64 if each in ends else 0 for each in range(32))))
        self._say(CONNECT, 0, struct.pack("<BBBBHHH", FULL_SPEED, 0, 0, 0, self.double.VENDOR, self.double.PRODUCT,
                                          self.device.firmware))

    def _packet(self, kind, number, body):
        if kind == HELLO:
            self.configured = 0
        elif kind == RESET:
            self.receiving, self.configured, self.asked = False, 0, []
        elif kind == SET_CONFIGURATION:
            self.configured = body[0]
            self._say(CONFIGURATION_STATUS, number, bytes([OK, body[0]]))
        elif kind == GET_CONFIGURATION:
            self._say(CONFIGURATION_STATUS, number, bytes([OK, self.configured]))
        elif kind in (SET_ALTERNATE, GET_ALTERNATE):
            self._say(ALTERNATE_STATUS, number, bytes([OK, body[0], 0]))
        elif kind in (START_INTERRUPT, STOP_INTERRUPT):
            self.receiving = kind == START_INTERRUPT
            self._say(INTERRUPT_STATUS, number, bytes([OK, body[0]]))
        elif kind == INTERRUPT:  # a report of the host
            self.double.output(body[4:], self.now())
            self._say(INTERRUPT, number, struct.pack("<BBH", body[0], OK, len(body) - 4))
        elif kind == BULK:
            self._bulk(number, body)
        elif kind == CANCEL:
            for each in [one for one in self.asked if one[0] == number]:
                self.asked.remove(each)
                self._say_bulk(number, each[1], CANCELLED, b"", 0)
        elif kind == CONTROL:
            self._control(number, body)

    def _bulk(self, number, body):
        """Of 10 bytes, with the upper half of the length last (32bits_bulk_length); a transfer to the machine waits."""
        end, _, low, _, high = struct.unpack_from("<BBHIH", body)
        size = low | high << 16
        if end & 0x80:
            self.asked.append((number, end, size))
            return
        self.double.bulk_out(body[10:], self.now())
        self._say_bulk(number, end, OK, b"", size)

    def _say_bulk(self, number, end, status, data, size):
        self._say(BULK, number, struct.pack("<BBHIH", end, status, size & 0xFFFF, 0, size >> 16) + data)

    def _control(self, number, body):
        end, request, kind, _, value, index, length = struct.unpack_from("<BBBBHHH", body)
        result, data = self.device.transfer(kind, request, value, index, length, body[10:], self.now())
        status = OK if result >= 0 else STALLED if result == STALL else IO_ERROR
        moved = max(result, 0)
        self._say(CONTROL, number, struct.pack("<BBBBHHH", end, request, kind, status, value, index, moved) + data)
