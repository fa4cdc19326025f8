"""Puts a double of an instrument on a pseudo-terminal, a TCP or UDP port, a FIFO, a Unix socket or the kernel's uinput.

  serve.py INSTRUMENT [--option k=v ...] (--pty | --tcp PORT | --udp PORT | --fifo PATH | --uinput | --socket PATH)
           [--baud N] [--seconds N] [--log FILE]

Prints one line with the path of the pseudo-terminal or socket or with 127.0.0.1:PORT, then answers each JSON command
on its standard input with one JSON line. README.md describes the commands and the frames of the socket.
SPDX-License-Identifier: Apache-2.0
"""

import argparse
import errno
import fcntl
import importlib
import json
import os
import pathlib
import pty
import select
import socket
import struct
import sys
import time
import tty

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from double import TIMED_OUT, ByteDouble, HidDouble, Refused, RegisterDouble, UsbDouble, plain  # noqa: E402
from ends import OrderInput, book, serving  # noqa: E402
from usbtmc import UsbtmcDouble, UsbtmcLine  # noqa: E402


def make(instrument, options):
    """The double of that name, with options as text: name=value."""
    try:
        module = importlib.import_module(instrument)
        kind = module.DOUBLE
    except (ImportError, AttributeError) as error:
        raise Refused(f"there is no double named '{instrument}'") from error
    pairs = {}
    for option in options:
        name, mark, value = option.partition("=")
        if not mark:
            raise Refused(f"option '{option}' is not name=value")
        pairs[name] = value
    return kind(**pairs)


class Pace:
    """A line that takes its time: each byte 10 bits."""

    def __init__(self, baud):
        self.per_byte = 10.0 / baud if baud else 0.0
        self.free = 0.0
        self.waiting = []

    def add(self, data, when):
        """Puts bytes on the line at that time."""
        if not self.per_byte:
            if data:
                self.waiting.append((when, data))
            return
        for byte in data:
            self.free = max(self.free, when) + self.per_byte
            self.waiting.append((self.free, bytes([byte])))

    def take(self, now):
        """The (time, bytes) that have arrived by now."""
        due = [each for each in self.waiting if each[0] <= now]
        self.waiting = [each for each in self.waiting if each[0] > now]
        return due

    def next(self):
        """The time of the next arrival, or None."""
        return self.waiting[0][0] if self.waiting else None


class PtyLink:
    """A pseudo-terminal; the server keeps the far side open, so that a client may come and go."""

    def __init__(self):
        self.master = self.slave = None
        self.plug()

    def plug(self):
        """Makes a pseudo-terminal and returns its path."""
        if self.master is None:
            self.master, self.slave = pty.openpty()
            tty.setraw(self.slave)
            os.set_blocking(self.master, False)
        return self.name()

    def unplug(self):
        """Takes the terminal away: the client reads EIO."""
        if self.master is not None:
            os.close(self.slave)
            os.close(self.master)
            self.master = self.slave = None

    def name(self):
        """The path for the client."""
        return os.ttyname(self.slave)

    def readable(self):
        """File descriptors to wait for."""
        return [] if self.master is None else [self.master]

    def read(self, _):
        """Bytes from the client."""
        try:
            return os.read(self.master, 65536)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data):
        """Bytes to the client; what does not fit is lost, as on a line without flow control."""
        if self.master is not None:
            try:
                os.write(self.master, data)
            except (BlockingIOError, OSError):
                pass


class StreamLink:
    """A listening stream socket with one client at a time."""

    def __init__(self, family, address):
        self.family, self.address = family, address
        self.listener = self.client = None
        self.plug()

    def plug(self):
        """Listens; returns the address for the client."""
        if self.listener is None:
            self.listener = socket.socket(self.family)
            if self.family == socket.AF_INET:
                self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.listener.bind(self.address)
            self.listener.listen(4)
            self.address = self.listener.getsockname()
        return self.name()

    def unplug(self):
        """Closes the connection and refuses new ones."""
        for each in (self.client, self.listener):
            if each is not None:
                each.close()
        if self.family == socket.AF_UNIX and self.listener is not None:
            os.unlink(self.address)
        self.client = self.listener = None

    def name(self):
        """The address for the client."""
        return self.address if self.family == socket.AF_UNIX else f"{self.address[0]}:{self.address[1]}"

    def readable(self):
        """File descriptors to wait for."""
        return [each.fileno() for each in (self.client or self.listener,) if each is not None]

    def read(self, _):
        """Bytes from the client; accepts one first."""
        if self.client is None:
            self.client, _ = self.listener.accept()
            if self.family == socket.AF_INET:
                self.client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.connected()
            return b""
        try:
            data = self.client.recv(65536)
        except OSError:
            data = b""
        if not data:
            self.client.close()
            self.client = None
        return data

    def connected(self):
        """Called when a client has come."""

    def write(self, data):
        """Bytes to the client, if there is one."""
        if self.client is not None:
            try:
                self.client.sendall(data)
            except OSError:
                self.client.close()
                self.client = None


class DatagramLink:
    """A UDP port; the answer goes to where the last datagram came from."""

    def __init__(self, address):
        self.address, self.socket, self.peer = address, None, None
        self.plug()

    def plug(self):
        """Takes the port; returns the address for the client."""
        if self.socket is None:
            self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.socket.bind(self.address)
            self.address = self.socket.getsockname()
        return self.name()

    def unplug(self):
        """Gives the port up: what is sent then is lost."""
        if self.socket is not None:
            self.socket.close()
        self.socket = self.peer = None

    def name(self):
        """The address for the client."""
        return f"{self.address[0]}:{self.address[1]}"

    def readable(self):
        """File descriptors to wait for."""
        return [] if self.socket is None else [self.socket.fileno()]

    def read(self, _):
        """One datagram of a client."""
        data, self.peer = self.socket.recvfrom(65536)
        return data

    def write(self, data):
        """One datagram to the last client."""
        if self.socket is not None and self.peer is not None:
            try:
                self.socket.sendto(data, self.peer)
            except OSError:
                pass


class FifoLink:
    """A FIFO of what the instrument says; what is said while nothing reads is lost, as with evdev."""

    def __init__(self, path):
        self.path, self.end = path, None
        self.there = False
        self.plug()

    def plug(self):
        """Makes the FIFO; returns its path."""
        if not self.there:
            os.mkfifo(self.path)
            self.there = True
        return self.path

    def unplug(self):
        """Takes it away: the reader reads an end of file."""
        if self.end is not None:
            os.close(self.end)
        if self.there:
            os.unlink(self.path)
        self.end, self.there = None, False

    def name(self):
        """The path for the client."""
        return self.path

    def readable(self):
        """There is nothing to wait for."""
        return []

    def write(self, data):
        """Bytes to the reader, whole or not at all."""
        try:
            if self.end is None and self.there:
                self.end = os.open(self.path, os.O_WRONLY | os.O_NONBLOCK)
            if self.end is not None:
                os.write(self.end, data)
        except OSError as error:
            if error.errno in (errno.EPIPE, errno.ENXIO) and self.end is not None:
                os.close(self.end)
                self.end = None


def ioc(direction, number, size):
    """Linux include/uapi/asm-generic/ioctl.h, of uinput's letter U: direction 1 writes, 2 reads."""
    return direction << 30 | size << 16 | ord("U") << 8 | number


# Linux include/uapi/linux/uinput.h
UI_DEV_CREATE, UI_DEV_DESTROY, UI_DEV_SETUP, UI_ABS_SETUP = ioc(0, 1, 0), ioc(0, 2, 0), ioc(1, 3, 92), ioc(1, 4, 28)
UI_SET_EVBIT, UI_SET_KEYBIT, UI_SET_ABSBIT, UI_GET_SYSNAME = ioc(1, 100, 4), ioc(1, 101, 4), ioc(1, 103, 4), ioc(2, 44, 64)


class UinputLink:
    """An input device of the kernel's own; needs /dev/uinput. The kernel sets the times of the events."""

    def __init__(self, table):
        self.table, self.device = table, None
        self.plug()

    def plug(self):
        """Makes the device; returns the path of its event node."""
        if self.device is None:
            self.device = os.open("/dev/uinput", os.O_WRONLY | os.O_NONBLOCK)
            for kind in (1, 3):
                fcntl.ioctl(self.device, UI_SET_EVBIT, kind)
            for code in self.table["keys"]:
                fcntl.ioctl(self.device, UI_SET_KEYBIT, code)
            for code, each in self.table["abs"].items():
                fcntl.ioctl(self.device, UI_SET_ABSBIT, int(code))
                fcntl.ioctl(self.device, UI_ABS_SETUP, abs_setup(int(code), each))
            fcntl.ioctl(self.device, UI_DEV_SETUP, device_setup(self.table))
            fcntl.ioctl(self.device, UI_DEV_CREATE)
        return self.name()

    def unplug(self):
        """Takes the device away: readers of its node get ENODEV."""
        if self.device is not None:
            fcntl.ioctl(self.device, UI_DEV_DESTROY)
            os.close(self.device)
        self.device = None

    def name(self):
        """The path of the event node, which udev may make a little later."""
        name = fcntl.ioctl(self.device, UI_GET_SYSNAME, bytes(64)).rstrip(b"\0").decode()
        nodes = sorted(pathlib.Path("/sys/devices/virtual/input", name).glob("event*"))
        return f"/dev/input/{nodes[0].name}" if nodes else name

    def readable(self):
        """There is nothing to wait for."""
        return []

    def write(self, data):
        """Whole events to the kernel."""
        if self.device is not None:
            os.write(self.device, data)


def abs_setup(code, axis):
    """struct uinput_abs_setup: code, two bytes of nothing, struct input_absinfo: value, least, most, fuzz, flat, resolution."""
    return struct.pack("<Hxx6i", code, 0, axis["minimum"], axis["maximum"], axis["fuzz"], axis["flat"], 0)


def device_setup(table):
    """struct uinput_setup: struct input_id, a name of 80 bytes, the number of effects."""
    return struct.pack("<4H80sI", table["bus"], table["vendor"], table["product"], table["version"], table["name"].encode(), 0)


class ByteServer:
    """A byte instrument on its line."""

    def __init__(self, double, link, baud, log):
        self.double, self.link, self.log = double, link, log
        self.inward, self.outward = Pace(baud), Pace(baud)

    def step(self, now, readable):
        """Moves all bytes that are due."""
        for descriptor in readable:
            self.inward.add(self.link.read(descriptor), now)
        for when, data in self.inward.take(now):
            self.log(when, "host", data)
            self.double.receive(data, when)
        for when, data in self.double.say(now):
            self.outward.add(data, when)
        for when, data in self.outward.take(now):
            self.log(when, "instrument", data)
            self.link.write(data)

    def next(self):
        """When there will be something to do."""
        return earliest(self.double.next(), self.inward.next(), self.outward.next())


class FrameServer:
    """A HID or USB instrument or a camera on a Unix socket: frames of a 32-bit little-endian length, a kind and a payload."""

    def __init__(self, double, link, log):
        self.double, self.link, self.log = double, link, log
        self.buffer = b""
        self.replies = []  # (time, frame)
        self.reading = None  # a bulk read that has nothing yet: (endpoint, length, until)

    def step(self, now, readable):
        """Takes whole frames, sends answers and reports that are due."""
        self.double.advance(now)
        for descriptor in readable:
            had = self.link.client
            data = self.link.read(descriptor)
            if self.link.client is not had:
                self.buffer, self.reading = b"", None  # a new client, or none
            self.buffer += data
        self.read_on(now)
        while self.reading is None and len(self.buffer) >= 4:
            (size,) = struct.unpack_from("<I", self.buffer)
            if len(self.buffer) < 4 + size:
                break
            frame, self.buffer = self.buffer[4:4 + size], self.buffer[4 + size:]
            self.log(now, "host", frame)
            self.frame(frame[:1], frame[1:], now)
        due = [each for each in self.replies if each[0] <= now]
        self.replies = [each for each in self.replies if each[0] > now]
        for when, frame in due:
            self.send(frame, when)
        if isinstance(self.double, HidDouble):
            while (report := self.double.input(now)) is not None:
                if self.link.client is not None:  # a report without a reader is gone
                    self.send(b"I" + report, now)
        if isinstance(self.double, RegisterDouble):
            for when, number, start, width, height, data in self.double.images(now):
                if self.link.client is not None:
                    head = struct.pack("<IQHH", number, round(start * 1e6), width, height)
                    self.send(b"P" + head + data, when)

    def send(self, frame, when):
        """Sends one frame."""
        self.log(when, "instrument", frame)
        self.link.write(struct.pack("<I", len(frame)) + frame)

    def frame(self, kind, body, now):
        """Carries out one frame of the client."""
        double = self.double
        if isinstance(double, HidDouble):
            if kind == b"O":
                self.replies.append((now, b"A" + struct.pack("<i", double.output(body, now))))
                return
            if kind == b"F":
                self.replies.append((now, b"A" + struct.pack("<i", double.feature(body, now))))
                return
            if kind == b"G":
                got = double.get_feature(body[0], now)
                whole = struct.pack("<i", got) if isinstance(got, int) else struct.pack("<i", len(got)) + got
                self.replies.append((now, b"A" + whole))
                return
        elif isinstance(double, RegisterDouble):
            if kind == b"Q" and len(body) == 4:
                value = double.read(struct.unpack("<I", body)[0], now)
                self.replies.append((now + double.late, b"A" + struct.pack("<iI", 4, value)))
                return
            if kind == b"W" and len(body) == 8:
                double.write(*struct.unpack("<II", body), now)
                self.replies.append((now + double.late, b"A" + struct.pack("<i", 4)))
                return
        elif kind == b"C" and len(body) >= 8:
            request_type, request, value, index, length = struct.unpack_from("<BBHHH", body)
            if request_type & 0x80:
                result, data = double.control(request_type, request, value, index, length, now)
            else:
                result, data = double.control(request_type, request, value, index, body[8:8 + length], now), b""
            self.replies.append((now + double.delay(), b"A" + struct.pack("<i", result) + data))
            return
        elif kind == b"B" and len(body) >= 1 and isinstance(double, UsbtmcDouble):
            self.replies.append((now, b"A" + struct.pack("<i", double.bulk_out(body[0], body[1:], now))))
            return
        elif kind == b"R" and len(body) == 9 and isinstance(double, UsbtmcDouble):
            endpoint, length, patience = struct.unpack("<BII", body)
            self.reading = (endpoint, length, now + patience / 1000)
            self.read_on(now)
            return
        self.replies.append((now, b"A" + struct.pack("<i", -errno.EINVAL)))

    def read_on(self, now):
        """Ends a bulk read when there are bytes, a halt, or no time left; the frames behind it wait."""
        if self.reading is None:
            return
        endpoint, length, until = self.reading
        got = self.double.bulk_in(endpoint, length, now)
        if got is None and now < until:
            return
        self.reading = None
        got = TIMED_OUT if got is None else got
        whole = struct.pack("<i", got) if isinstance(got, int) else struct.pack("<i", len(got)) + got
        self.replies.append((now, b"A" + whole))

    def next(self):
        """When there will be something to do."""
        reading = (self.reading[2], self.double.wait_in()) if self.reading is not None else ()
        return earliest(self.double.next(), *reading, *(each[0] for each in self.replies[:1]))


def earliest(*times):
    """The least of the times that are not None, or None."""
    return min((each for each in times if each is not None), default=None)


class Orders:
    """The JSON commands on standard input."""

    def __init__(self, double, link):
        self.double, self.link = double, link

    def obey(self, text, now):
        """Carries out one line and returns the answer."""
        try:
            order = json.loads(text)
            if not isinstance(order, dict) or len(order) != 1:
                raise Refused("one command a line, as {\"get\": \"state\"}")
            ((name, value),) = order.items()
            act = getattr(self, "do_" + name, None)
            if act is None:
                raise Refused(f"no command '{name}'")
            answer = act(value, now)
        except (Refused, ValueError, TypeError) as error:
            return {"error": str(error)}
        return answer if answer is not None else {"ok": True}

    def do_set(self, value, now):
        """Changes physical state or options from outside."""
        self.double.arrange(now, **value)

    def do_mode(self, value, now):
        """Changes options."""
        self.double.advance(now)
        self.double.mode(**value)

    def do_get(self, value, now):
        """Tells the state, or one part of it."""
        state = self.double.state(now)
        if value == "state":
            return state
        if value not in state:
            raise Refused(f"no state '{value}'")
        return {value: state[value]}

    def do_history(self, value, now):
        """Tells the history: all of it, or what happened since a number of lines."""
        self.double.advance(now)
        start = value if isinstance(value, int) and not isinstance(value, bool) else 0
        return {"history": plain(self.double.history[start:])}

    def do_power_cycle(self, value, now):
        """Switches the instrument off and on."""
        self.double.advance(now)
        self.double.power_cycle(now)

    def do_unplug(self, value, now):
        """Takes the connection away; the instrument stays powered."""
        self.link.unplug()

    def do_plug(self, value, now):
        """Gives the connection back."""
        return {"link": self.link.plug()}

    def do_now(self, value, now):
        """Tells the server's time."""
        return {"now": now}


def loop(server, orders, link, seconds):
    """Serves until the time is over or standard input ends."""
    start = time.monotonic()
    given = OrderInput(seconds)
    while True:
        now = time.monotonic() - start
        if seconds is not None and now >= seconds:
            return
        wait = earliest(server.next(), seconds)
        waiting = link.readable() + given.readable()
        # An instrument that changes all the time is looked at every millisecond.
        timeout = None if wait is None else max(0.0, min(wait - now, 3600.0))
        ready, _, _ = select.select(waiting, [], [], timeout)
        now = time.monotonic() - start
        if 0 in ready and not given.take(lambda line: orders.obey(line, now)):
            return
        server.step(now, [each for each in ready if each != 0 and each in link.readable()])


def shown(data):
    """The first bytes, and how many there are."""
    return data[:256].hex(" ") + (f" ... {len(data)} bytes" if len(data) > 256 else "")


def main():
    """Reads the arguments and serves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("instrument")
    parser.add_argument("--option", action="append", default=[], metavar="K=V")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--pty", action="store_true")
    where.add_argument("--tcp", type=int, metavar="PORT")
    where.add_argument("--udp", type=int, metavar="PORT")
    where.add_argument("--fifo", metavar="PATH")
    where.add_argument("--uinput", action="store_true")
    where.add_argument("--socket", metavar="PATH")
    parser.add_argument("--baud", type=int, default=0)
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--log", metavar="FILE")
    given = parser.parse_args()
    try:
        double = make(given.instrument, given.option)
    except Refused as error:
        parser.error(str(error))
    if not isinstance(double, (ByteDouble, HidDouble, UsbDouble, RegisterDouble)):
        parser.error(f"{given.instrument} has a server of its own: gige_serve.py")
    bytewise = isinstance(double, ByteDouble) or (isinstance(double, UsbtmcDouble) and not given.socket)
    if bytewise == bool(given.socket):
        parser.error(f"{given.instrument} is served " + ("on --pty, --tcp, --udp or --fifo" if given.socket else "on --socket"))
    log = book(given.log, shown)
    if given.uinput and not hasattr(double, "capabilities"):
        parser.error(f"{given.instrument} is no input device")
    if given.uinput:
        try:
            link = UinputLink(double.capabilities)
        except OSError as error:
            parser.error(f"no uinput: {error}")
    elif given.fifo:
        link = FifoLink(given.fifo)
    elif given.pty:
        link = PtyLink()
    elif given.socket:
        link = StreamLink(socket.AF_UNIX, given.socket)
    elif given.udp is not None:
        link = DatagramLink(("127.0.0.1", given.udp))
    else:
        link = StreamLink(socket.AF_INET, ("127.0.0.1", given.tcp))
    if bytewise:
        line = UsbtmcLine(double) if isinstance(double, UsbtmcDouble) else double
        server = ByteServer(line, link, given.baud, log)
    else:
        server = FrameServer(double, link, log)
    with serving(link):
        print(link.name(), flush=True)
        loop(server, Orders(double, link), link, given.seconds)


if __name__ == "__main__":
    main()
