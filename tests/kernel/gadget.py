"""An instrument's end of a real node of this machine's kernel, with a double of tests/doubles behind it.

  gadget.py hid|uhid|acm|usbip INSTRUMENT [--option k=v ...] [--numbered] [--udc dummy_udc.0] [--size N]

hid and acm are USB gadgets on the dummy controller (/dev/hidg0 <-> /dev/hidraw0, /dev/ttyGS0 <-> /dev/ttyACM0), uhid is
a HID device without a bus, usbip any USB device behind the kernel's virtual controller (vhci_hcd). Prints "ready", then answers each JSON order on standard input with one line: those of
tests/doubles/README.md, and three more:

  {"raw": "00 02"}      an input report as it is
  {"began": true}       what the monotonic clock read when the history's clock read 0
  {"reset_seen": true}  how often the host took the configuration away from this device
SPDX-License-Identifier: Apache-2.0
"""

import argparse
import errno
import os
import pathlib
import socket
import struct
import sys
import termios
import time
import tty

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "doubles"))

import serve  # noqa: E402
from usb_device import UsbDevice  # noqa: E402

GADGETS = pathlib.Path("/sys/kernel/config/usb_gadget")
# Reports of a USB-3103 by their ids, bytes behind the id: the fact sheet's table, a command without data gets one byte,
# for a report of none is none.
OUT = {0x01: 1, 0x02: 2, 0x03: 1, 0x04: 1, 0x05: 1, 0x06: 2, 0x14: 4, 0x15: 1, 0x1C: 2, 0x20: 1, 0x21: 1, 0x30: 4,
       0x31: 62, 0x40: 1, 0x41: 1, 0x43: 1, 0x44: 1}
IN = {0x03: 1, 0x05: 1, 0x21: 4, 0x30: 62, 0x44: 1}


def descriptor(reports):
    """A report descriptor of the vendor's own page: (kind, id or None, bytes), kind "in" or "out"."""
    text = bytes([0x06, 0x00, 0xFF, 0x09, 0x01, 0xA1, 0x01, 0x15, 0x00, 0x26, 0xFF, 0x00, 0x75, 0x08])
    for kind, number, size in reports:
        if number is not None:
            text += bytes([0x85, number])
        text += bytes([0x95, size, 0x09, 0x02, 0x81 if kind == "in" else 0x91, 0x02])
    return text + b"\xc0"


def report_descriptor(double, numbered, size):
    """What the double's kind of device tells the kernel of its reports."""
    name = type(double).__name__
    if name == "Usb3103" and numbered:
        return descriptor([("out", number, size) for number, size in OUT.items()] +
                          [("in", number, size) for number, size in IN.items()])
    if name == "Spacemouse":  # NAV: reports 1, 2 (or 1 with all), 3; light 4
        axes = [("in", 1, 12)] if double.combined else [("in", 1, 6), ("in", 2, 6)]
        return descriptor(axes + [("in", 3, 2), ("out", 4, 1)])
    return descriptor([("in", None, size), ("out", None, size)])


class HidGadget:
    """f_hid: a full HID device behind the dummy controller."""

    def __init__(self, double, given):
        self.udc, self.number = given.udc, int(given.udc[-1])
        self.folder = GADGETS / f"g{self.number}"
        self.node = None
        self.lost = 0
        self.function = self._make(double, report_descriptor(double, given.numbered, given.size))
        self.plug()

    def _make(self, double, described):
        serial = getattr(double, "serial", "1")
        make_gadget(self.folder, double.VENDOR, double.PRODUCT, serial)
        function = self.folder / f"functions/hid.{self.number}"
        function.mkdir()
        for name, value in (("protocol", "0"), ("subclass", "0"), ("report_length", "64")):
            (function / name).write_text(value)
        (function / "report_desc").write_bytes(described)
        os.symlink(function, self.folder / f"configs/c.1/hid.{self.number}")
        return function

    def plug(self):
        """Binds to the controller; the host sees a new device."""
        if self.node is None:
            (self.folder / "UDC").write_text(self.udc)
            minor = (self.function / "dev").read_text().strip().split(":")[1]
            self.node = os.open(wait_for(f"/dev/hidg{minor}"), os.O_RDWR | os.O_NONBLOCK)
        return self.udc

    def unplug(self):
        """The cable is out; the instrument keeps its power."""
        if self.node is not None:
            (self.folder / "UDC").write_text("\n")
            os.close(self.node)
            self.node = None

    def readable(self):
        """Descriptors to wait for."""
        return [] if self.node is None else [self.node]

    def receive(self):
        """One report of the host, or None."""
        try:
            return os.read(self.node, 4096)
        except BlockingIOError:
            return None
        except OSError as error:  # a reset by the host: there is no configuration for a moment
            if error.errno not in (errno.ESHUTDOWN, errno.EAGAIN, errno.EIO, errno.ECONNRESET):
                raise
            self.lost += 1
            return None

    def send(self, report):
        """Whether the report could be put on the wire, or was lost for good."""
        if self.node is None:
            return True
        try:
            os.write(self.node, report)
        except BlockingIOError:
            return False
        except OSError as error:
            if error.errno not in (errno.ESHUTDOWN, errno.EIO, errno.ECONNRESET):
                raise
            self.lost += 1
        return True


class UserHid:
    """/dev/uhid: a HID device without a bus, whose reports may have any length."""

    DESTROY, CREATE2, INPUT2, OUTPUT, GET, GET_REPLY, SET, SET_REPLY = 1, 11, 12, 6, 9, 10, 13, 14  # linux/uhid.h

    def __init__(self, double, given):
        self.double, self.described = double, report_descriptor(double, False, given.size)
        self.node, self.lost = None, 0
        self.plug()

    def plug(self):
        """A new device."""
        if self.node is None:
            self.node = os.open("/dev/uhid", os.O_RDWR | os.O_NONBLOCK)
            name = type(self.double).__name__.encode()
            os.write(self.node, struct.pack("<I128s64s64sHHIIII4096s", self.CREATE2, name, b"uhid", b"1", len(self.described),
                                            3, self.double.VENDOR, self.double.PRODUCT, 1, 0, self.described))
        return "uhid"

    def unplug(self):
        """The device is gone."""
        if self.node is not None:
            os.close(self.node)
            self.node = None

    def readable(self):
        """Descriptors to wait for."""
        return [] if self.node is None else [self.node]

    def receive(self):
        """An output report of the host, or None for what is none."""
        event = os.read(self.node, 4380)
        kind = struct.unpack_from("<I", event)[0]
        if kind == self.OUTPUT:
            size = struct.unpack_from("<H", event, 4 + 4096)[0]
            return event[4:4 + size]
        if kind == self.GET:
            request = struct.unpack_from("<I", event, 4)[0]
            os.write(self.node, struct.pack("<IIHH4096s", self.GET_REPLY, request, errno.EIO, 0, b""))
        if kind == self.SET:
            request = struct.unpack_from("<I", event, 4)[0]
            os.write(self.node, struct.pack("<IIH", self.SET_REPLY, request, errno.EIO))
        return None

    def send(self, report):
        """Always taken."""
        if self.node is not None:
            os.write(self.node, struct.pack("<IH4096s", self.INPUT2, len(report), report))
        return True


class HidServer:
    """Carries reports between a double and its device, in order."""

    def __init__(self, double, link):
        self.double, self.link, self.waiting = double, link, []

    def step(self, now, readable):
        """Moves all reports that are due."""
        for _ in readable:
            report = self.link.receive()
            if report is not None:
                self.double.output(report, now)
        while (report := self.double.input(now)) is not None:
            self.waiting.append(report)
        while self.waiting and self.link.send(self.waiting[0]):
            self.waiting.pop(0)

    def next(self):
        """When there will be something to do; a report that waits for the host is tried again soon."""
        return self.double.now + 0.001 if self.waiting else self.double.next()


class AcmGadget:
    """f_acm: a modem of the communication class, /dev/ttyACM0 for the host; this end is /dev/ttyGS0."""

    def __init__(self, double, given):
        self.udc, self.folder = given.udc, GADGETS / f"g{given.udc[-1]}"
        self.node = None
        vendor, product = (int(part, 16) for part in given.usb_id.split(":"))
        make_gadget(self.folder, vendor, product, "A1B2C3")
        (self.folder / "functions/acm.0").mkdir()
        os.symlink(self.folder / "functions/acm.0", self.folder / "configs/c.1/acm.0")
        self.plug()

    def plug(self):
        """Binds to the controller."""
        if self.node is None:
            (self.folder / "UDC").write_text(self.udc)
            self._open()
        return "ttyACM0"

    def _open(self):
        self.node = os.open(wait_for("/dev/ttyGS0"), os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
        # With echo the two ends would talk for ever. At once: what was not sent before a reset is sent when the host has
        # opened its end again, and to wait for that is to wait for ever.
        termios.tcflush(self.node, termios.TCIOFLUSH)
        tty.setraw(self.node, termios.TCSANOW)

    def unplug(self):
        """The cable is out."""
        if self.node is not None:
            (self.folder / "UDC").write_text("\n")
            os.close(self.node)
            self.node = None

    def name(self):
        """Of the kernel's device."""
        return "ttyACM0"

    def readable(self):
        """Descriptors to wait for."""
        return [] if self.node is None else [self.node]

    def read(self, node):
        """Bytes of the host. A reset by the host hangs this end up: it is opened anew."""
        try:
            data = os.read(node, 65536)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data and node == self.node:
            os.close(self.node)
            self._open()
        return data

    def write(self, data):
        """Bytes to the host; lost without one."""
        try:
            if self.node is not None:
                os.write(self.node, data)
        except OSError:
            pass


class UsbIp:
    """A device behind vhci_hcd, by the messages of Linux' Documentation/usb/usbip_protocol.rst on a socket of this process."""

    SUBMIT, UNLINK, SUBMITTED, UNLINKED = 1, 2, 3, 4
    CONTROLLER = pathlib.Path("/sys/devices/platform/vhci_hcd.0")
    FULL_SPEED = 2

    def __init__(self, double, given):
        self.double, self.device, self.lost = double, UsbDevice(double), 0
        self.port = given.port
        self.socket, self.buffer = None, b""
        self.asked = []  # transfers to the host that wait for data: (number, bytes)
        self.plug()

    def plug(self):
        """Attaches one end of a socket to the controller."""
        if self.socket is None:
            self.socket, far = socket.socketpair()
            self.buffer, self.asked = b"", []
            (self.CONTROLLER / "attach").write_text(f"{self.port} {far.fileno()} {self.port + 2} {self.FULL_SPEED}\n")
            far.close()  # the kernel has it
        return "usbip"

    def unplug(self):
        """The cable is out."""
        if self.socket is not None:
            self.socket.close()
            self.socket = None

    def readable(self):
        """Descriptors to wait for."""
        return [] if self.socket is None else [self.socket.fileno()]

    def step(self, now, readable):
        """Takes what has come; answers what can be answered."""
        if readable and self.socket is not None:
            data = self.socket.recv(65536)
            if not data:  # the controller has let go
                self.unplug()
                return
            self.buffer += data
        while len(self.buffer) >= 48:
            kind, number, _, towards_host, end = struct.unpack_from(">5I", self.buffer)
            size = struct.unpack_from(">I", self.buffer, 0x18)[0] if kind == self.SUBMIT and not towards_host else 0
            if len(self.buffer) < 48 + size:
                break
            head, body, self.buffer = self.buffer[:48], self.buffer[48:48 + size], self.buffer[48 + size:]
            if kind == self.UNLINK:
                self._unlink(number, struct.unpack_from(">I", head, 0x14)[0])
            elif end == 0:
                self._control(number, head, body, now)
            elif towards_host:
                self.asked.append((number, struct.unpack_from(">I", head, 0x18)[0]))
            else:
                self.double.bulk_out(body, now)
                self._answer(number, 0, size)
        self.double.advance(now)
        while self.asked and (data := self.double.bulk_in(self.asked[0][1], now)) is not None:
            self._answer(self.asked.pop(0)[0], 0, len(data), data)

    def _control(self, number, head, body, now):
        kind, request, value, index, length = struct.unpack_from("<BBHHH", head, 0x28)
        result, data = self.device.transfer(kind, request, value, index, length, body, now)
        self._answer(number, min(result, 0), max(result, 0), data)

    def _unlink(self, number, which):
        waiting = [each for each in self.asked if each[0] == which]
        self.asked = [each for each in self.asked if each[0] != which]
        self._send(struct.pack(">5Ii24x", self.UNLINKED, number, 0, 0, 0, -errno.ECONNRESET if waiting else 0))

    def _answer(self, number, status, moved, data=b""):
        self._send(struct.pack(">5IiIIII8x", self.SUBMITTED, number, 0, 0, 0, status, moved, 0, 0xFFFFFFFF, 0) + data)

    def _send(self, message):
        try:
            if self.socket is not None:
                self.socket.sendall(message)
        except OSError:
            self.unplug()

    def next(self):
        """An adapter that nothing waits for makes no packets."""
        return self.double.next() if self.asked else self.double.next_event()


def make_gadget(folder, vendor, product, serial):
    """A USB device with one configuration; without a function yet."""
    for name in (folder / "strings/0x409", folder / "configs/c.1/strings/0x409"):
        name.mkdir(parents=True)
    for name, value in (("idVendor", f"{vendor:#06x}"), ("idProduct", f"{product:#06x}"), ("bcdUSB", "0x0200"),
                        ("bcdDevice", "0x0100"), ("strings/0x409/serialnumber", serial),
                        ("strings/0x409/manufacturer", "Double"), ("strings/0x409/product", "Double")):
        (folder / name).write_text(value)


def wait_for(path):
    """The path, once it is there."""
    until = time.monotonic() + 5
    while not os.path.exists(path):
        if time.monotonic() > until:
            raise SystemExit(f"{path} has not come within 5 s")
        time.sleep(0.002)
    return path


class Orders(serve.Orders):
    """The doubles' orders, and three of this machine's."""

    def do_raw(self, value, now):
        """An input report as it is."""
        self.double.report(bytes.fromhex(value), now)

    def do_began(self, value, now):
        """The zero of the history's clock on the monotonic one."""
        return {"began": time.monotonic() - now}

    def do_reset_seen(self, value, now):
        """How often the host took the configuration away."""
        return {"reset_seen": self.link.lost}


def main():
    """Reads the arguments and serves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=("hid", "uhid", "acm", "usbip"))
    parser.add_argument("instrument")
    parser.add_argument("--option", action="append", default=[], metavar="K=V")
    parser.add_argument("--numbered", action="store_true", help="reports have ids in the descriptor")
    parser.add_argument("--udc", default="dummy_udc.0")
    parser.add_argument("--port", type=int, default=0, help="of the virtual controller")
    parser.add_argument("--usb-id", default="1d6b:0104", help="of an acm gadget")
    parser.add_argument("--size", type=int, default=64, help="bytes of a report without an id")
    given = parser.parse_args()
    double = serve.make(given.instrument, given.option)
    if given.kind == "acm":
        link = AcmGadget(double, given)
        server = serve.ByteServer(double, link, 0, lambda *_: None)
    elif given.kind == "usbip":
        link = server = UsbIp(double, given)
    else:
        link = (HidGadget if given.kind == "hid" else UserHid)(double, given)
        server = HidServer(double, link)
    print("ready", flush=True)
    try:
        serve.loop(server, Orders(double, link), link, None)
    finally:
        link.unplug()


if __name__ == "__main__":
    main()
